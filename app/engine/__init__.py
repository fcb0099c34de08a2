"""One run: its events, its folder and its numbers."""
