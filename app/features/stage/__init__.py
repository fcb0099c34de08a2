"""The stage: what is drawn over the frames, where the eye of the 3-D view stands, and what a click selects."""
