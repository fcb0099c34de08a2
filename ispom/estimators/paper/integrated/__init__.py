"""Section 6.3, integrated position and orientation; its steps are the file names."""
