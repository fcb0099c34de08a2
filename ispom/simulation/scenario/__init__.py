"""Scenarios: a simulated scene with faults, as values; what each one does to the images, times or calibration."""
