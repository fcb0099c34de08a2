"""What an error of the calibration does to a trajectory: predicted from what a run saw, without running it again."""
