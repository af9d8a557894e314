"""The stereo cameras, and the measurement of image points."""
