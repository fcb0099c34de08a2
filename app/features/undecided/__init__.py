"""`ispom undecided`: what the images of a recording, or of a planned motion, do not decide."""
