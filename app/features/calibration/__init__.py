"""`ispom calibrate`."""
