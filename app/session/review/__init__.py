"""Runs that are over, read from their folders and recordings as the page shows them."""
