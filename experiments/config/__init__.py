"""A comparison, read from YAML into frozen models."""
