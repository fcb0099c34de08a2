"""Trajectories of other programs, shown together with a run."""
