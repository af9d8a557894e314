"""The result tables of README.md and docs/, made from kept results."""
