"""What can be hidden in the views, besides methods: names, and what people read."""

from __future__ import annotations

LAYERS = {
    "truth": "true path",
    "beside": "paths of other programs",
    "cameras": "camera frusta",
    "uncertainty": "95 % ellipsoids of the poses",
    "key_frames": "key frames",
    "clouds": "point clouds",
    "tracks": "tracks on images",
    "trails": "trails of tracks",
    "disparity": "disparity",
}
IMAGE_LAYERS = ("tracks", "trails", "disparity")
