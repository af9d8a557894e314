"""What is grasped at any orientation, and put into holes."""
