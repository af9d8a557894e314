"""Arms that can touch what stands around them, and themselves."""
