"""The whole procedure of a grasp: approach, turn, descend, close, lift (paper, 3.1, 3.4 and 3.5)."""
