"""One setting with a few values, run beside each other: what can be asked, and the process that runs it."""
