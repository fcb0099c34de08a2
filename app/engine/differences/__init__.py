"""What differs between two runs, frame by frame."""
