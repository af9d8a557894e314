"""Rivals with a memory over trials: regression over all looks, without or with a prior from simulated worlds."""
