"""The quantities that the time dock plots."""
