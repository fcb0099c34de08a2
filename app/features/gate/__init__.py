"""`ispom gate`: whether a change of the code made results better, worse, or neither, run by run."""
