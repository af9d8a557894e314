"""Perturbations in anybody's environment, and what they cost a policy."""
