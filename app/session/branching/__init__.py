"""Branches of a run, and how they compare."""
