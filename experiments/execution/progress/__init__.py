"""How far a suite is: what is shown, how long runs take, and how long the rest will."""
