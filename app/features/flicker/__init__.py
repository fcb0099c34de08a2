"""Two methods or branches, one drawn at a time."""
