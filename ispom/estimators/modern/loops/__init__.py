"""Loops: a place that is seen again after a long way, and what follows for all poses between."""
