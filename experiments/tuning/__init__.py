"""Tuning for every agent alike: Optuna, the same number of tries, the same CPU time, worlds of its own."""
