"""How agents begin to move, in worlds where they can have an accident."""
