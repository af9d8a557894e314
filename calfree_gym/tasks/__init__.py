"""What is asked: each task in a file of its own."""
