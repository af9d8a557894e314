"""A recurrent network that servos in worlds it never saw: the network, its training, and the agent."""
