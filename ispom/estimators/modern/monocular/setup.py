"""The camera and the settings of the monocular method, in the units that are computed with."""

from __future__ import annotations

from dataclasses import dataclass

from ispom.estimators.modern.motions import Follow
from ispom.features.interfaces import FrontEnd
from ispom.geometry import Array
from ispom.types import Camera

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
MIN_INLIER_SHARE = 0.6
"""A pose refined from a prediction that fewer of its points agree with is sought again by RANSAC."""


@dataclass(frozen=True, eq=False)
class Setup:
    """See ModernMonocularConfig for what the settings mean."""

    camera: Camera
    noise_px: float
    """Error of a track before any data [px]."""
    loss_px: float
    """Width of the robust loss [px]."""
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

    @property
    def noise(self) -> float:
        """Error of a track before any data, normalised."""
        return self.noise_px / self.camera.fx

    @property
    def sigma(self) -> float:
        """Width of the robust loss, normalised."""
        return self.loss_px / self.camera.fx
