"""Detection of targets in images: the position and uncertainty of each point, and why others are rejected."""
