"""A stereo pair as the tracker sees it: its images, the points alive in it, and where those of the last one are now."""

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
    """Grey images of one exposure, the right one as bright as the left."""

    time_ns: int
    left: Image
    right: Image

    @staticmethod
    def of(exposure: Frame) -> NewPair:
        left = as_grey(exposure.left)
        return NewPair(exposure.time_ns, left, as_bright(as_grey(exposure.right), left))

    @cached_property
    def half(self) -> Image:
        """The left image at half its size."""
        return np.asarray(cv2.pyrDown(self.left), np.uint8)

    @cached_property
    def halves(self) -> tuple[Image, Image]:
        """The left and the right image at half size where they are wide."""
        return (self.half, halved(self.right)) if factor_of(self.left) == 2 else (self.left, self.right)


@dataclass(frozen=True, eq=False)
class PairPoints:
    """The points alive in a pair."""

    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) ascending."""
    uv: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(N, 2) [px] in the left image."""
    disparity_px: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    """(N,) NaN where unknown."""
    slants: Array = field(default_factory=lambda: np.zeros((0, 2)))
    """(N, 2) of their surfaces, see features.slanted; 0 where unknown."""

    def __len__(self) -> int:
        return len(self.ids)

    @staticmethod
    def joined(a: PairPoints, b: PairPoints) -> PairPoints:
        return PairPoints(
            np.concatenate([a.ids, b.ids]),
            np.concatenate([a.uv, b.uv]),
            np.concatenate([a.disparity_px, b.disparity_px]),
            np.concatenate([a.slants, b.slants]),
        )

    def seen_by(self, camera: Camera) -> Array:
        """(N, 3) normalised x, y in the left image, x in the right one or NaN."""
        x = camera.normalise(self.uv)
        return np.column_stack([x, x[:, 0] - self.disparity_px / camera.fx])

    def select(self, keep: NDArray[np.bool_]) -> PairPoints:
        return PairPoints(self.ids[keep], self.uv[keep], self.disparity_px[keep], self.slants[keep])


@dataclass(frozen=True, eq=False)
class TrackingResult:
    """Where the points of the last pair are in this one."""

    uv: NDArray[np.float32]
    """(N, 2) [px] in the left image."""
    disparity_px: NDArray[np.float32]
    """(N,) NaN where not found in the right image."""
    slants: Array
    """(N, 2) 0 where not found there."""
    status: NDArray[np.uint8]
    place: NDArray[np.int64]
    """(N,) in the map, or -1."""
    located: PoseFit | None
    took_part: NDArray[np.int64]
    """(K,) which of the points `located` is about."""
    lower: NDArray[np.float32]
    """(K,) normalised: how much lower these are in the right image; NaN where not found."""
    motion: Array | None = None
    """(12,) of left_from_world while rows were exposed, as of rolling.mean_rates; of a rolling shutter."""
    relocated: bool = False
    """Located by descriptors: since the last pair anything may have happened."""

    @staticmethod
    def nothing() -> TrackingResult:
        empty, none = np.zeros(0, np.int64), PairPoints()
        return TrackingResult(
            none.uv, none.disparity_px, none.slants, empty.astype(np.uint8), empty, None, empty, none.disparity_px
        )

    def alive(self, points: PairPoints) -> PairPoints:
        """Those of the points followed that are alive, at their places now."""
        keep = self.status == TrackStatus.ALIVE
        return PairPoints(points.ids[: len(keep)][keep], self.uv[keep], self.disparity_px[keep], self.slants[keep])

    @property
    def inliers(self) -> int:
        return 0 if self.located is None else int(self.located.inliers.sum())
