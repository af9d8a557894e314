"""Neural learners. All but those that teach themselves load torch, and only when they are made."""
