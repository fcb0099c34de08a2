"""Trajectories, maps and numbers of a run in other programs' formats."""
