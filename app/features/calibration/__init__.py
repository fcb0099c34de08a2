"""`ispom calibrate` and `ispom target`."""
