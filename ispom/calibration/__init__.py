"""The calibrations of Fig. 2: interior of a camera, stereo pair, rig; and what their errors do to a trajectory."""
