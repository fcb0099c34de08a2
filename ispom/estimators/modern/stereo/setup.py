"""The camera and the settings of the stereo method, in the units that are computed with."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from ispom.estimators.modern.motions import Follow
from ispom.estimators.modern.stereo.shutter import Shutter
from ispom.features.front_ends import KLT
from ispom.features.interfaces import FrontEnd
from ispom.geometry import Array, Pose
from ispom.numerics.robust import Noise
from ispom.types import Camera


@dataclass(frozen=True, eq=False)
class Setup:
    """See ModernStereoConfig for what the settings mean."""

    camera: Camera
    """The left one; the right one is the same."""
    baseline_m: float
    rig_from_left: Pose
    noise_px: Noise
    """Of a track before any data [px]."""
    max_error_px: float
    extra_sigma: Array
    """(E,) of what may be wrong with the pair (see right_camera.TERMS); 0 holds it."""
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
    """Whose descriptors find lost pairs and loops again."""

    @cached_property
    def left_from_rig(self) -> Pose:
        return self.rig_from_left.inverse()

    @cached_property
    def shutter(self) -> Shutter:
        """Of both cameras."""
        return Shutter.of(self.camera)

    @cached_property
    def noise(self) -> Noise:
        """The same in normalised units."""
        return self.noise_px.times(1 / self.camera.fx)

    @property
    def limit(self) -> float:
        """Larger reprojection errors end a track, normalised."""
        return self.max_error_px / self.camera.fx

    @property
    def self_calibration(self) -> bool:
        return bool(self.extra_sigma.any())
