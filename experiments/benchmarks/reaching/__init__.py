"""What agents reach, beside what is required of them; by points, and by pixels."""
