"""The pose of a camera on the rig, and its clock, from how the cameras moved."""
