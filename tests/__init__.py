"""A package, so that nothing installed is taken for it: draccus, which LeRobot needs, has its own `tests`."""
