"""Sensitivity to calibration errors: predicts the trajectory from the observations of a run, without a new run."""
