"""Trajectories of other programs over the same source."""
