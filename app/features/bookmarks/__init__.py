"""Marks and notes at frames of a source."""
