"""Protocols of detectors, descriptors, matchers and trackers, and the front end that combines one of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.types import Image

Allowed = Callable[[slice], NDArray[np.bool_]]
"""Returns, for a slice of the features of a, which features of b each may match: (rows, len(b))."""


@dataclass(frozen=True, eq=False)
class Features:
    """Described points of one image."""

    uv: NDArray[np.float32]
    """(N, 2) [px]."""
    descriptors: NDArray
    """(N, D) unit vectors, as float32 or, times 255, as uint8; or packed bits as uint8. (N, 0) for tracked points."""

    def __len__(self) -> int:
        return len(self.uv)

    def __getitem__(self, some: NDArray[np.int64] | NDArray[np.bool_]) -> Features:
        return Features(self.uv[some], self.descriptors[some])

    @property
    def described(self) -> bool:
        """Returns whether the points have descriptors."""
        return self.descriptors.shape[1] > 0

    def after(self, uv: NDArray[np.float32]) -> Features:
        """Returns points (M, 2) with blank descriptors, which match nothing, followed by these features."""
        blank = np.zeros((len(uv), self.descriptors.shape[1]), self.descriptors.dtype)
        return Features(np.concatenate([uv, self.uv]), np.concatenate([blank, self.descriptors]))

    def compact(self) -> Features:
        """Returns the features with descriptors as bytes: 4 % of a typical entry; distances change by less than 1 %."""
        if self.descriptors.dtype == np.uint8:
            return self
        return Features(self.uv, np.rint(255.0 * self.descriptors).astype(np.uint8))


class Detector(Protocol):
    """Finds points that can be tracked."""

    def detect(
        self, grey: Image, count: int, occupied: NDArray[np.float32], min_distance_px: float
    ) -> NDArray[np.float32]:
        """Returns new points (M, 2) [px], spread over the image, that bring the number of points to about `count`.

        Before refinement, each keeps `min_distance_px` from the others and from the `occupied` ones (N, 2) [px].
        """
        ...


class Descriptor(Protocol):
    """Describes points so that they can be matched in any other image."""

    def detect_and_describe(self, grey: Image, count: int) -> Features:
        """Returns about `count` features of an image, the strongest ones, no two at the same point."""
        ...

    def describe(self, grey: Image, uv: NDArray[np.float32]) -> Features:
        """Returns points (N, 2) [px] of an image with upright descriptors of one scale, as tracking needs them."""
        ...


class Matcher(Protocol):
    """Matches features of two images, of one kind of descriptors."""

    def match(self, a: Features, b: Features) -> NDArray[np.int64]:
        """Returns index pairs (M, 2), each feature once: the best matches, if clearly better than the second best."""
        ...

    def match_where(self, a: Features, b: Features, allowed: Allowed) -> tuple[NDArray[np.int64], Array]:
        """Returns, for each feature of `a`, the most similar allowed one of `b`, if it is similar enough.

        The result is index pairs (M, 2), each of `a` once, and their similarity (M,), 1 for equal descriptors.
        """
        ...


class Tracker(Protocol):
    """Tracks points from one image into the next."""

    def track(
        self, start: Image, end: Image, uv: NDArray[np.float32], predicted: NDArray[np.float32] | None = None
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Returns the positions (N, 2) in `end` of points (N, 2) [px] of `start`, and TrackStatus (N,): ALIVE if found.

        The search starts at `predicted` (N, 2) [px]. Positions of points that were not found are meaningless.
        """
        ...


@dataclass(frozen=True)
class FrontEnd:
    """A named combination of algorithms that supplies an estimator with tracks and matches."""

    name: str
    reference: str
    """Publications of the algorithms."""
    detector: Detector
    tracker: Tracker
    """Tracks without predictions from a map."""
    guided: Tracker
    """Tracks from predictions by a map and a motion model; the caller checks its results."""
    descriptor: Descriptor
    """Describes features for wide steps, relocalisation and loops."""
    matcher: Matcher
    """Matches the features of `descriptor`."""
