"""Forks of a run, and their comparison."""
