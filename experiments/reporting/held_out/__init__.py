"""Scenarios with held-out trials: learning curves against lifetime motions."""
