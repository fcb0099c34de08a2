"""`ispom evaluate`: compares trajectories of any program with a reference."""
