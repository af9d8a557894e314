"""What others are measured against: words drawn at random, and the arm as it really is."""
