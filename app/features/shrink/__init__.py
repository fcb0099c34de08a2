"""`ispom shrink`: the smallest clip of a recording in which a failure remains."""
