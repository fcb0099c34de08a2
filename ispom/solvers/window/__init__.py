"""Bundle adjustment of a window of poses and points."""
