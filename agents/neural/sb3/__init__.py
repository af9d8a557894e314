"""Any algorithm of stable-baselines3 or sb3_contrib as an agent."""
