"""The camera and settings of the stereo method, and what it handles in one frame: images, points, tracks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.loops.asked import Asked
from ispom.estimators.modern.second_motion import Follow
from ispom.features.front_ends import KLT, front_end
from ispom.features.images import as_bright, factor_of, halved
from ispom.features.interfaces import FrontEnd
from ispom.features.klt import Klt
from ispom.features.shi_tomasi import ShiTomasi
from ispom.geometry import Array, Pose
from ispom.numerics.robust import Noise
from ispom.solvers.localisation import PoseFit
from ispom.solvers.window.problem import PoseFamily
from ispom.types import Camera, Frame, Image, TrackStatus, as_grey

CROWD = 2.0
"""Most points in a part of the image, relative to an equal share. Without a limit the strongest corners cluster, mostly
far ahead, and common errors, such as one edge's disparity, do not average out. With equal shares many are weak."""
PAIR_KLT = replace(KLT, detector=ShiTomasi(crowd=CROWD), guided=Klt(levels=2, max_forward_backward_px=np.inf))
"""The default front end: `klt`, for a method that searches the keyframe's patches first (track.search_patches). Its
guided tracker has no backward check, as the keyframe's patch checks the result."""


def pair_front_end(name: str) -> FrontEnd:
    """Returns the front end of this name, `klt` as it suits pairs. Raises InputError where there is none."""
    return PAIR_KLT if name == PAIR_KLT.name else front_end(name)


@dataclass(frozen=True, eq=False)
class Setup:
    """The rig and the settings in the units of the computation; see ModernStereoConfig for their meaning."""

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
    """See state.StereoMap.with_key."""
    max_tracks: int
    window: int
    min_parallax_px: float
    min_share: float
    min_inliers: int
    max_lost_pairs: int
    iterations: int
    relocalise: bool
    follow: Follow
    make_families: tuple[Callable[[Setup, Any], PoseFamily], ...] = ()
    """Each makes a further residual family of the window, from the keyframes of a state.StereoMap."""
    front_end: FrontEnd = PAIR_KLT
    asked: Asked = Asked()
    """Loops that the settings decide."""

    @cached_property
    def left_from_rig(self) -> Pose:
        """Returns the pose of the rig's frame in the left camera."""
        return self.rig_from_left.inverse()

    def families(self, world: Any) -> tuple[PoseFamily, ...]:
        """Returns the window's further residual families, from the keyframes of a state.StereoMap."""
        return tuple(make(self, world) for make in self.make_families)

    @property
    def searches_patches(self) -> bool:
        """Returns whether points are found by the keyframe's patches, before the front end tracks them."""
        return self.front_end == PAIR_KLT

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
        """Returns whether any correction of the calibration is estimated."""
        return bool(self.extra_sigma.any())


@dataclass(frozen=True, eq=False)
class StereoImages:
    """The grey images of one frame, the right one as bright as the left one."""

    time_ns: int
    left: Image
    right: Image

    @staticmethod
    def of(frame: Frame) -> StereoImages:
        """Converts a stereo frame to grey images of equal brightness."""
        left = as_grey(frame.left)
        return StereoImages(frame.time_ns, left, as_bright(as_grey(frame.right), left))

    @cached_property
    def half(self) -> Image:
        """Returns the left image at half size."""
        return np.asarray(cv2.pyrDown(self.left), np.uint8)

    @cached_property
    def halves(self) -> tuple[Image, Image]:
        """Returns the left and the right image, at half size if they are large."""
        return (self.half, halved(self.right)) if factor_of(self.left) == 2 else (self.left, self.right)


def seen_by(camera: Camera, uv: NDArray[np.float32], disparity_px: NDArray[np.float32]) -> Array:
    """Returns observations (N, 3) of points at `uv` (N, 2) [px]: normalised x, y in the left image, x in the right one
    or NaN."""
    x = camera.normalise(uv)
    return np.column_stack([x, x[:, 0] - disparity_px / camera.fx])


@dataclass(frozen=True, eq=False)
class PairPoints:
    """The points alive in a frame."""

    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) ids, ascending."""
    uv: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(N, 2) [px] in the left image."""
    disparity_px: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    """(N,) disparities [px]; NaN where unknown."""
    slants: Array = field(default_factory=lambda: np.zeros((0, 2)))
    """(N, 2) slants of the points' surfaces, see features.slanted; 0 where unknown."""

    def __len__(self) -> int:
        return len(self.ids)

    @staticmethod
    def joined(a: PairPoints, b: PairPoints) -> PairPoints:
        """Returns the points of `a`, followed by those of `b`."""
        return PairPoints(
            np.concatenate([a.ids, b.ids]),
            np.concatenate([a.uv, b.uv]),
            np.concatenate([a.disparity_px, b.disparity_px]),
            np.concatenate([a.slants, b.slants]),
        )

    def seen_by(self, camera: Camera) -> Array:
        """Returns observations (N, 3): normalised x, y in the left image, x in the right one or NaN."""
        return seen_by(camera, self.uv, self.disparity_px)

    def select(self, keep: NDArray[np.bool_]) -> PairPoints:
        """Returns the points of the mask `keep` (N,)."""
        return PairPoints(self.ids[keep], self.uv[keep], self.disparity_px[keep], self.slants[keep])


@dataclass(frozen=True, eq=False)
class TrackingResult:
    """The last frame's points (N,) in this frame, and the pose that they give."""

    uv: NDArray[np.float32]
    """(N, 2) [px] in the left image."""
    disparity_px: NDArray[np.float32]
    """(N,) disparities [px]; NaN where not found in the right image."""
    slants: Array
    """(N, 2) slants; 0 where not found in the right image."""
    status: NDArray[np.uint8]
    """(N,) TrackStatus."""
    place: NDArray[np.int64]
    """(N,) indices in the map, or -1."""
    located: PoseFit | None
    """The pose; None before localisation, and if it failed."""
    took_part: NDArray[np.int64]
    """(K,) indices of the points that are alive in the left image, from which `located` is estimated."""
    lower: NDArray[np.float32]
    """(K,) vertical disparities, normalised, positive if lower on the right; NaN where not found."""
    motion: Array | None = None
    """(12,) motion of left_from_world during the exposure of a rolling shutter, see rolling.steady."""
    relocated: bool = False
    """Whether descriptors localised the frame; the motion since the last frame is then unknown."""
    as_predicted: bool = False
    """Whether enough points were found where the motion model predicts them."""

    @staticmethod
    def nothing() -> TrackingResult:
        """Returns the result without any points."""
        return TrackingResult.in_left(PairPoints().uv, np.zeros(0, np.uint8), np.zeros(0, np.int64))

    @staticmethod
    def in_left(uv: NDArray[np.float32], status: NDArray[np.uint8], place: NDArray[np.int64]) -> TrackingResult:
        """Returns the result of tracking in the left image only."""
        unknown, none = np.full(len(uv), np.nan, np.float32), np.zeros(0, np.int64)
        return TrackingResult(uv, unknown, np.zeros((len(uv), 2)), status, place, None, none, none.astype(np.float32))

    def alive(self, points: PairPoints) -> PairPoints:
        """Returns the tracked points that are alive, at their current positions."""
        keep = self.status == TrackStatus.ALIVE
        return PairPoints(points.ids[: len(keep)][keep], self.uv[keep], self.disparity_px[keep], self.slants[keep])

    def better(self, other: TrackingResult) -> TrackingResult:
        """Returns the one of the two with more inliers; this one if equal, unless it has no tracks."""
        return self if len(self.status) and self.inliers >= other.inliers else other

    @property
    def inliers(self) -> int:
        """Returns the number of inliers of the pose; 0 without one."""
        return 0 if self.located is None else int(self.located.inliers.sum())
