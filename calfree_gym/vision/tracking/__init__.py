"""Image points found in images: from colours to blobs, from blobs to balls, from balls to points."""
