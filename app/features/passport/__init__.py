"""`ispom passport`: a folder by which another person repeats, verifies and cites a run."""
