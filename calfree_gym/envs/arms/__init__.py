"""N arms in N worlds at their trials: of every task, and what their cameras deliver."""
