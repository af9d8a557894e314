"""Mobile robots on wheels, which dock."""
