"""`ispom doctor`: which cause explains a bad stretch of a run, and what to do about it."""
