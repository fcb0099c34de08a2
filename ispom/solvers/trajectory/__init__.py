"""Aligns, interpolates and anchors trajectories."""
