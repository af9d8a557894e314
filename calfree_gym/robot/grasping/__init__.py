"""A gripper that can hold, things that it can hold, and the physics of both."""
