"""The camera and the settings of the stereo method, in the units of the computation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from ispom.estimators.modern.second_motion import Follow
from ispom.features.front_ends import KLT
from ispom.features.interfaces import FrontEnd
from ispom.geometry import Array, Pose
from ispom.numerics.robust import Noise
from ispom.types import Camera


@dataclass(frozen=True, eq=False)
class Setup:
    """See ModernStereoConfig for what the settings mean."""

    camera: Camera
    """The left camera; the right one has the same parameters."""
    baseline_m: float
    rig_from_left: Pose
    noise_px: Noise
    """Prior noise of a track [px]."""
    max_error_px: float
    extra_sigma: Array
    """(E,) prior standard deviations of the corrections (see right_camera.TERMS); 0 fixes one."""
    settling_s: float
    """See window.with_key."""
    max_tracks: int
    window: int
    min_parallax_px: float
    min_share: float
    min_inliers: int
    max_lost_pairs: int
    iterations: int
    relocalise: bool
    follow: Follow
    front_end: FrontEnd = KLT
    """Its descriptors are used for relocalisation and loops."""

    @cached_property
    def left_from_rig(self) -> Pose:
        return self.rig_from_left.inverse()

    @property
    def rolls(self) -> bool:
        """Returns whether both cameras have a rolling shutter."""
        return self.camera.line_delay_s != 0.0

    @cached_property
    def noise(self) -> Noise:
        """Returns the prior noise of a track in normalised units."""
        return self.noise_px.times(1 / self.camera.fx)

    @property
    def limit(self) -> float:
        """Returns the largest reprojection error of an inlier, normalised."""
        return self.max_error_px / self.camera.fx

    @property
    def self_calibration(self) -> bool:
        return bool(self.extra_sigma.any())
