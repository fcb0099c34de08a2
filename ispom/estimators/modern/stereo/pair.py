"""Data of tracking in stereo frames: images, points alive, and tracking results."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.features.images import as_bright, factor_of, halved
from ispom.geometry import Array
from ispom.solvers.localisation import PoseFit
from ispom.types import Camera, Frame, Image, TrackStatus, as_grey


@dataclass(frozen=True, eq=False)
class NewPair:
    """The grey images of one frame, the right one as bright as the left one."""

    time_ns: int
    left: Image
    right: Image

    @staticmethod
    def of(exposure: Frame) -> NewPair:
        """Converts a stereo frame to grey images of equal brightness."""
        left = as_grey(exposure.left)
        return NewPair(exposure.time_ns, left, as_bright(as_grey(exposure.right), left))

    @cached_property
    def half(self) -> Image:
        """Returns the left image at half size."""
        return np.asarray(cv2.pyrDown(self.left), np.uint8)

    @cached_property
    def halves(self) -> tuple[Image, Image]:
        """Returns the left and the right image, at half size if they are large."""
        return (self.half, halved(self.right)) if factor_of(self.left) == 2 else (self.left, self.right)


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
        x = camera.normalise(self.uv)
        return np.column_stack([x, x[:, 0] - self.disparity_px / camera.fx])

    def select(self, keep: NDArray[np.bool_]) -> PairPoints:
        """Returns the points of the mask `keep` (N,)."""
        return PairPoints(self.ids[keep], self.uv[keep], self.disparity_px[keep], self.slants[keep])


@dataclass(frozen=True, eq=False)
class TrackingResult:
    """The result of tracking the last frame's points into this one."""

    uv: NDArray[np.float32]
    """(N, 2) [px] in the left image."""
    disparity_px: NDArray[np.float32]
    """(N,) disparities [px]; NaN where not found in the right image."""
    slants: Array
    """(N, 2) slants; 0 where not found in the right image."""
    status: NDArray[np.uint8]
    place: NDArray[np.int64]
    """(N,) indices in the map, or -1."""
    located: PoseFit | None
    took_part: NDArray[np.int64]
    """(K,) indices of the points that `located` was estimated from."""
    lower: NDArray[np.float32]
    """(K,) vertical disparities, normalised, positive if lower on the right; NaN where not found."""
    motion: Array | None = None
    """(12,) motion of left_from_world during the exposure of a rolling shutter, see rolling.steady."""
    relocated: bool = False
    """Whether descriptors localised the frame; the motion since the last frame is then unknown."""

    @staticmethod
    def nothing() -> TrackingResult:
        """Returns the result without any points."""
        empty, none = np.zeros(0, np.int64), PairPoints()
        return TrackingResult(
            none.uv, none.disparity_px, none.slants, empty.astype(np.uint8), empty, None, empty, none.disparity_px
        )

    def alive(self, points: PairPoints) -> PairPoints:
        """Returns the tracked points that are alive, at their current positions."""
        keep = self.status == TrackStatus.ALIVE
        return PairPoints(points.ids[: len(keep)][keep], self.uv[keep], self.disparity_px[keep], self.slants[keep])

    @property
    def inliers(self) -> int:
        """Returns the number of inliers of the pose; 0 without one."""
        return 0 if self.located is None else int(self.located.inliers.sum())
