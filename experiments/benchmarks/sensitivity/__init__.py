"""Which constants of the agents matter, by halving and doubling each."""
