"""Signals at random moments over the commands that write files: no crash, no traceback, no process left behind."""
