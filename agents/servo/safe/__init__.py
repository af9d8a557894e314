"""How a robot begins to move that knows nothing of itself (paper, section 5, fourth question)."""
