"""One setting with a few values, run in parallel: what can be swept, and the process that runs it."""
