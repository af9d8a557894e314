"""Rivals that remember: regression over all looks, without or with a prior from simulated worlds."""
