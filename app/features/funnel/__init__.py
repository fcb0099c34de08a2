"""Funnel: what becomes of the features of an image on the way to a pose, and which stage limits that."""
