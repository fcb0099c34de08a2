"""Trajectories: aligned, interpolated, anchored."""
