"""The error budget of a run with ground truth: how much of its error each cause makes."""
