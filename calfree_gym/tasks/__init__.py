"""Tasks: distances, rewards and success."""
