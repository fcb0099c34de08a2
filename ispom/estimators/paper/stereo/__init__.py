"""Section 6.2, position and orientation from stereo cameras; its steps are the file names."""
