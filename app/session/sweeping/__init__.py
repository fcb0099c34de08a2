"""The sweep that was begun in the page."""
