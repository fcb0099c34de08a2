"""`ispom evaluate`: trajectories of any program beside a reference."""
