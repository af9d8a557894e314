"""What a calibrated robot believes of itself, and how it finds that out from its own motions."""
