"""An arm as a value, what follows from it, and the RV-M2."""
