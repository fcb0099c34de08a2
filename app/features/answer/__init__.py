"""Answer: one line for the frame shown. What went wrong, since when, why, and what to do."""
