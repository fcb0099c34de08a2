"""Events of a run: what happened at which frame to which method, in words."""
