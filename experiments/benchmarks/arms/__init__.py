"""What other people's arms do: whether they reach, and how they begin to move."""
