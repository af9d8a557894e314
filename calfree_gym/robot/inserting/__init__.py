"""A gripper that holds a peg, a plate with a hole, and their physics."""
