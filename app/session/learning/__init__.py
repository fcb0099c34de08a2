"""The lesson that is on: its step, what may be seen and done, and the runs that reveal."""
