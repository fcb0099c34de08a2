"""What the images do not decide: the weakest combination of scale and numbers of the calibration in a stretch."""
