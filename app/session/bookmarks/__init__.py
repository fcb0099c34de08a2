"""Places in a run that somebody marked, with notes."""
