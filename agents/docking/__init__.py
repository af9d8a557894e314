"""Docking of a mobile robot: the paper's servo, a third virtual motor for it, and a projective model of arcs."""
