"""Estimates a trajectory as one spline from the observations of all cameras of a rig."""
