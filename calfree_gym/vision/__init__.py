"""The stereo pair, and what a measurement of its image points adds."""
