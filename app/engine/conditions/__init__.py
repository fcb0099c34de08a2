"""Conditions over the quantities of a frame, for break points, `--until` and lessons."""
