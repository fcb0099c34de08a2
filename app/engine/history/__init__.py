"""The exposures of a run, within a budget of memory."""
