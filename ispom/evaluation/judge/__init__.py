"""Judges poses of any program by the tracks of the recording that they belong to, without truth."""
