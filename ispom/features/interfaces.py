"""What finds, describes, matches and tracks image points: the Protocols, and a front end, which names one of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.types import Image

Allowed = Callable[[slice], NDArray[np.bool_]]
"""Which features of b each of some rows of a may match: (rows, len(b))."""


@dataclass(frozen=True, eq=False)
class Features:
    """Described points of one image."""

    uv: NDArray[np.float32]
    """(N, 2) [px]."""
    descriptors: NDArray
    """(N, D): unit vectors as float32 or, 255 times, as uint8; or packed bits as uint8. (N, 0) for tracked points."""

    def __len__(self) -> int:
        return len(self.uv)

    def __getitem__(self, some: NDArray[np.int64] | NDArray[np.bool_]) -> Features:
        return Features(self.uv[some], self.descriptors[some])

    @property
    def described(self) -> bool:
        return self.descriptors.shape[1] > 0

    def after(self, uv: NDArray[np.float32]) -> Features:
        """Returns points (M, 2) that match nothing, followed by these."""
        blank = np.zeros((len(uv), self.descriptors.shape[1]), self.descriptors.dtype)
        return Features(np.concatenate([uv, self.uv]), np.concatenate([blank, self.descriptors]))

    def compact(self) -> Features:
        """Returns the same with descriptors as bytes. A step is 4 % of a typical entry: no distance changes by 1 %."""
        if self.descriptors.dtype == np.uint8:
            return self
        return Features(self.uv, np.rint(255.0 * self.descriptors).astype(np.uint8))


class Detector(Protocol):
    """Finds points that can be tracked."""

    def detect(
        self, grey: Image, count: int, occupied: NDArray[np.float32], min_distance_px: float
    ) -> NDArray[np.float32]:
        """Returns new points (M, 2) [px], spread over the image, that bring the number of points to about `count`.

        None is nearer than `min_distance_px` to another one, or to those that are `occupied` (N, 2) [px], before its
        position is refined.
        """
        ...


class Descriptor(Protocol):
    """Describes points so that they can be recognised in another image, whatever lies between."""

    def detect_and_describe(self, grey: Image, count: int) -> Features:
        """Returns about `count` features of an image, the strongest ones, no two at the same point."""
        ...

    def describe(self, grey: Image, uv: NDArray[np.float32]) -> Features:
        """Returns points (N, 2) [px] of an image, described upright and at one scale, as tracking needs it."""
        ...


class Matcher(Protocol):
    """Decides which features of two images are of the same point. Of descriptors of one kind only."""

    def match(self, a: Features, b: Features) -> NDArray[np.int64]:
        """Returns index pairs (M, 2), each feature once: best matches that are clearly better than the second best."""
        ...

    def match_where(self, a: Features, b: Features, allowed: Allowed) -> tuple[NDArray[np.int64], Array]:
        """Returns for features of `a` the most similar of those of `b` that are allowed, where it is similar enough:
        index pairs (M, 2), each of `a` once, and their similarity (M,), 1 for equal descriptors."""
        ...


class Tracker(Protocol):
    """Follows points from one image into the next."""

    def track(
        self, start: Image, end: Image, uv: NDArray[np.float32], predicted: NDArray[np.float32] | None = None
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Returns where points (N, 2) [px] of `start` are in `end`, and their TrackStatus (N,): ALIVE where found.

        `predicted` (N, 2) [px] is where to look first. The position of a point that was not found means nothing.
        """
        ...


@dataclass(frozen=True)
class FrontEnd:
    """A named combination of algorithms, by which an estimator sees."""

    name: str
    reference: str
    """The publications."""
    detector: Detector
    tracker: Tracker
    """Where nothing is known of the motion but that before."""
    guided: Tracker
    """Where a map and a motion model predict each point; what it finds is checked afterwards."""
    descriptor: Descriptor
    """For what tracking does not bridge: wide steps, a lost camera, loops."""
    matcher: Matcher
    """Of its descriptors."""
