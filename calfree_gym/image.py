"""Images and their units: image points lie in [-1, 1], x right, y down; ±1 is the image's border."""

CAMERAS = ("left", "right")
"""The stereo pair, in the order in which every array holds them."""
IMAGE_SIZE = 512
"""Width and height of an image in pixels."""
IMAGE_UNIT = 2 / IMAGE_SIZE
"""A pixel in image units."""
