"""The estimators: the paper's, as printed, and modern ones."""
