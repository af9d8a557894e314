"""What every agent has: the surface of stable-baselines3, procedures, observations, saved files."""
