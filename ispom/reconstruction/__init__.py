"""Dense models from the images of a run, and other sensors' points in its world (section 2 of the paper: a datum)."""
