"""Which tests the default run leaves to `.ci/run`."""

FULL = ()
"""Beginnings of paths of tests with the mark `full`: other browsers' pages, notebooks, programs beside ISPOM, signals,
studies and mutated files. They take more than half of the time of all."""
