"""Dense models of what a run saw, and other sensors' points placed by its poses (section 2 of the paper: a datum)."""
