"""The camera and the settings of the monocular method, in the units of the computation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from ispom.estimators.modern.loops.asked import Asked
from ispom.estimators.modern.second_motion import Follow
from ispom.features.interfaces import FrontEnd
from ispom.geometry import Array
from ispom.numerics.robust import Noise
from ispom.types import Camera

LOSS = 1.5
"""Width of the robust loss, in standard deviations of a tracked coordinate."""
INLIER = 4.0
"""Inlier limit of a point, in loss widths: 2.0 px at the default noise."""
WIDTH = INLIER / 2
"""Width of the loss for localising a frame, relative to the map's."""
MISTRACKED = 6.0
"""Residual, in loss widths, beyond which the track of a map point ends: 3.1 px are more than the tracking error."""
MOVING = 8.0
"""Residual, in loss widths, beyond which a track does not observe a static point (from its epipolar line, or from its
point): 4.1 px. It is wider than for map points, as the errors of the pose and of a young point are added."""


@dataclass(frozen=True, eq=False)
class Setup:
    """Camera and settings; ModernMonocularConfig describes the settings."""

    camera: Camera
    noise_px: Noise
    """Noise of a track before it is measured [px]."""
    extra_sigma: Array
    """(2,) prior standard deviations of the lens correction, scaled like the loss; 0 fixes it."""
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
    asked: Asked = Asked()
    """Loops and joins that the settings decide."""

    @cached_property
    def noise(self) -> Noise:
        """The same in normalised units."""
        return self.noise_px.times(1 / self.camera.fx)
