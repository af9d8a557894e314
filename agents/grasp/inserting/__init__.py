"""A peg into a hole: along the gripper's axis over any servo, and the procedure of Yoshimi & Allen (1994)."""
