"""Servos: procedures that seek the rendezvous, written to be read beside the paper."""
