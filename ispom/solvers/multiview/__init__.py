"""Poses and points from two, three or more views."""
