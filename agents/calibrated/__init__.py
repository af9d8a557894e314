"""What a calibrated robot knows of itself in numbers, how it acts by that, and how it identifies it."""
