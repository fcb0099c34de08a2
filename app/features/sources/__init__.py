"""Opening a source."""
