"""Section 6.1, position and orientation from a single camera; its steps are the file names."""
