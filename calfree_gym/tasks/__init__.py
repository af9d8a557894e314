"""What is asked of the arm."""
