"""The frames of a run, within a budget of memory."""
