"""`ispom run`: the methods over a source without a window, into a folder that is complete or says that it is not."""
