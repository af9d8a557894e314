"""Neural learners. These load torch, and only when they are made."""
