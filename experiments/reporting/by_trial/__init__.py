"""Scenarios counted in trials: learning curves against trials."""
