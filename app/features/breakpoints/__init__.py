"""Conditions that pause a run, and moves to the frames where they hold."""
