"""The camera and the settings of the monocular method, in the units that are computed with."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from ispom.estimators.modern.motions import Follow
from ispom.features.interfaces import FrontEnd
from ispom.geometry import Array
from ispom.numerics.robust import Noise
from ispom.types import Camera

LOSS = 1.5
"""Width of the robust loss, in standard deviations of a tracked coordinate."""
INLIER = 4.0
"""A point agrees with a pose, or with the map, within so many widths of the loss: 2.0 px at the default noise."""
WIDTH = INLIER / 2
"""Of the loss by which a frame is located, over the map's."""
MISTRACKED = 6.0
"""Beyond so many the track of a map point ends: 3.1 px are more than tracking is off by on the same point."""
MOVING = 8.0
"""Beyond so many a track is no image of a still point (from its epipolar line, or from its point): 4.1 px. Wider than
for map points, as the pose's error, and that of a young point, come in addition."""
TURN_LOSS = 3.0
"""Width of the loss where a pure turn is fitted, in those of a pose: parallax is an error there, too."""


@dataclass(frozen=True, eq=False)
class Setup:
    """See ModernMonocularConfig for what the settings mean."""

    camera: Camera
    noise_px: Noise
    """Of a track before any data [px]."""
    extra_sigma: Array
    """(2,) deviations of the lens correction before any data, widened as the loss is; 0 holds it."""
    max_tracks: int
    key_frames: int
    start_parallax_rad: float
    point_parallax_rad: float
    min_parallax_deg: float
    min_share: float
    max_view_angle_deg: float
    max_interval_s: float
    relocalise: bool
    follow: Follow
    front_end: FrontEnd

    @cached_property
    def noise(self) -> Noise:
        """The same in normalised units."""
        return self.noise_px.times(1 / self.camera.fx)
