"""Calibration targets: their points, and how they are printed."""
