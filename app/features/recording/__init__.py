"""Recordings of the run on the screen."""
