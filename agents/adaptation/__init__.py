"""How a robot recognises that its world has changed, and what it then does (paper, section 5)."""
