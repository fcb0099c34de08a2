"""Adjustment of a window of poses and points."""
