"""What an agent remembers from one reach to the next (paper, section 4)."""
