"""Poses of any program: a table of dialects, recognised by their content."""
