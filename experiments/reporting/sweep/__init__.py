"""Sweeps: success and motions against one setting of a perturbation."""
