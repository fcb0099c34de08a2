"""The commands that open the page."""
