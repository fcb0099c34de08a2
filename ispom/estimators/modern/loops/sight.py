"""What a key frame saw, kept small: described features with their points, to be compared with what is seen later."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.keyframe_database import appearance_of
from ispom.features.interfaces import Features, Matcher
from ispom.geometry import Array
from ispom.types import Camera, Image

FEATURES = 800
"""Described in an image: 120 kB a key frame."""


@dataclass(frozen=True, eq=False)
class Sight:
    x: NDArray[np.float32]
    """(N, 2) normalised, without distortion."""
    descriptors: NDArray[np.uint8]
    """(N, D), see Features.compact."""
    xyz: NDArray[np.float32]
    """(N, 3) in the camera and the unit of then; NaN where the depth is not known."""
    looks: NDArray[np.float32]
    """See keyframe_database.appearance_of."""
    depth: float
    """Of half of what is seen; nan where nothing is."""

    @staticmethod
    def of(grey: Image, x: Array, features: Features, xyz: Array | None = None, depth: float | None = None) -> Sight:
        """`depth` is that of half of the points (N, 3), where it is not told."""
        kept = np.asarray(features.compact().descriptors, np.uint8)
        points = np.full((len(x), 3), np.nan, np.float32) if xyz is None else xyz.astype(np.float32)
        if depth is None:
            known = points[np.isfinite(points[:, 2]), 2]
            depth = float(np.median(known)) if len(known) else float("nan")
        return Sight(x.astype(np.float32), kept, points, appearance_of(grey), depth)

    def features(self, fx: float) -> Features:
        """At the pixels of a camera without distortion, around its centre."""
        return Features(fx * self.x, self.descriptors)

    def with_depth(self) -> Sight:
        """Only what has a depth."""
        known = np.isfinite(self.xyz[:, 2])
        return replace(self, x=self.x[known], descriptors=self.descriptors[known], xyz=self.xyz[known])


@dataclass(frozen=True, eq=False)
class Eye:
    """The camera, or pair, as sights are compared."""

    fx: float
    low: Array
    """(2,) normalised, of the image's corner at the top left."""
    high: Array
    """(2,) of that at the bottom right."""
    sigma: float
    """Deviation of a feature's place, normalised."""
    matcher: Matcher
    baseline: float
    """Of a pair; 0 for one camera, whose unit drifts."""

    @staticmethod
    def of(camera: Camera, sigma: float, matcher: Matcher, baseline: float = 0.0) -> Eye:
        corners = camera.normalise(np.array([[0.0, 0.0], [camera.width - 1.0, camera.height - 1.0]]))
        return Eye(camera.fx, corners[0], corners[1], sigma, matcher, baseline)

    def in_sight(self, near: Array) -> Array:
        """(N, 2) normalised, of points (N, 3) in the camera; NaN for those out of its image."""
        with np.errstate(divide="ignore", invalid="ignore"):
            x = near[:, :2] / near[:, 2:]
        inside = (near[:, 2] > 0) & (x > self.low).all(axis=1) & (x < self.high).all(axis=1)
        return np.where(inside[:, None], x, np.nan)
