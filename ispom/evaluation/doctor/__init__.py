"""The doctor: finds the cause of a bad stretch of a recording from the images themselves. It uses ground truth only to
judge a setting of a run."""
