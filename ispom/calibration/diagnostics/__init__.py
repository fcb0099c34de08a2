"""How good a calibration is: what is not determined, where it is uncertain, and what to film next."""
