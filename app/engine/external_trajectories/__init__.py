"""Trajectories of other programs, shown beside a run."""
