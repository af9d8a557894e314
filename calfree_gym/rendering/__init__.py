"""Pictures of the scene: what the stereo cameras see, and frames for people."""
