"""What the images leave undecided: the weakest combination of scale and numbers of the calibration in a stretch."""
