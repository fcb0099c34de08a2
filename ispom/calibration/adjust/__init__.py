"""The joint problem: cameras, where they sit on the rig, and where the board was, from its points in images."""
