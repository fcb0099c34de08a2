"""Thousands of mutated inputs, each of which ends in a sensible success or in one sentence: `python -m tests.fuzz`."""
