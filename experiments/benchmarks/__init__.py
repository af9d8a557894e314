"""What agents and environments reach, and how fast: `python -m experiments benchmark`."""
