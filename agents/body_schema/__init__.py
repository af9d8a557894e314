"""Learns what its body is, from motions that are made anyway: a chain of joints before two cameras."""
