"""Layers that can be hidden in the views, in addition to methods: names and labels."""

from __future__ import annotations

LAYERS = {
    "truth": "ground truth",
    "beside": "paths of other programs",
    "cameras": "camera frusta",
    "error": "position errors at the frame shown",
    "uncertainty": "95 % ellipsoids of the poses",
    "key_frames": "keyframes",
    "clouds": "point clouds",
    "depth": "dense depth of the stereo pair",
    "map": "dense map",
    "tracks": "tracks on images",
    "moving": "moving objects",
    "trails": "trails of tracks",
    "disparity": "disparity",
    "overlay": "lines, flow and tags",
}
HINTS = {
    "truth": "The ground truth of the whole recording, and the rig where it truly is at the frame shown.",
    "beside": "Trajectories given by --beside, up to the frame shown.",
    "cameras": "Where each method has the camera at the frame shown, as the outline of what it sees.",
    "error": "A line from each method's position at the frame shown to the true one.",
    "uncertainty": "The camera is inside with a probability of 95 %, by the method's own covariance.",
    "key_frames": "The outlines of the cameras at the keyframes.",
    "clouds": "The points that each method triangulated, in the colours of the image.",
    "depth": "Points of the latest stereo pair by semi-global matching, at most 20,000, in the colours of the image, "
    "in the pose of the metric method shown. While the run plays they follow about once a second. A recording has them "
    "of the pairs that are recorded while this is on.",
    "map": "The dense mesh, and a laser's points, that ispom map made of the run.",
    "tracks": "The tracks of the frame on its image, coloured as chosen under Look.",
    "moving": "Tracks on a second rigid motion, such as a car, on their image.",
    "trails": "Where the tracks were in the last ten frames.",
    "overlay": "What a method draws besides its tracks: line segments in the colours of their directions, flow, tags.",
    "disparity": "From each point of the left image to its place in the right one [px].",
}
OPTIONAL = frozenset({"depth"})
"""Layers that are drawn only when a person chooses them: they cost time."""
MEASURES = "measures"
"""Name for all plots and texts, which are in no layer and which a lesson hides."""
IMAGE_LAYERS = {layer: layer for layer in ("tracks", "moving", "trails", "disparity")} | {"overlay": "lines"}
"""By layer: the name of its entity below that of an image. A layer never has the name of a method."""
