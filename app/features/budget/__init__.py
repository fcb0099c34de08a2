"""`ispom budget`: the error of a run with ground truth, split by causes."""
