"""A film of an agent at work: the scene, both camera images, what is observed and what was predicted."""
