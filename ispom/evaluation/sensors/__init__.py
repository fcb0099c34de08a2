"""Whether sensors fit the motion of the images: their clock, mount, unit and bias, each with its standard deviation."""
