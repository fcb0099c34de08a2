"""What errors of the calibration do to the trajectories of a run."""
