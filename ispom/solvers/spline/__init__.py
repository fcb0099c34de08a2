"""One trajectory as a spline through what all cameras of a rig saw."""
