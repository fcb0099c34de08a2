"""Database of keyframes for relocalisation: their number is bounded, and they are ranked by similarity to an image."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.features.descriptors import SEARCH_SIDE_PX
from ispom.features.interfaces import Descriptor, Features
from ispom.geometry import Array, Pose
from ispom.types import Image

MAX_KEYFRAMES = 48
"""Largest number of keyframes. Their images take 30 MB at most; beyond it, older keyframes are thinned out evenly."""
RECENT = 8
"""Number of the newest keyframes, which are never thinned out: after a short gap they share most of the image
content."""
FEATURES = 2000
"""Largest number of features described in an image."""
CANDIDATES = 2
"""Number of keyframes compared with an image besides the newest one, by similarity of appearance. The next frame
continues with the next ones: the time per frame is bounded, and several frames compare all keyframes."""
NEIGHBOURS = (1, 3, 6)
"""Steps back to the keyframes with which the features of a keyframe are triangulated, for a single camera."""
COARSE_PX = (40, 30)
"""Size of the blurred images by which keyframes are ranked (Klein & Murray 2008, section 4)."""


@dataclass(frozen=True, eq=False)
class Keyframe:
    """Images and pose of a camera or a stereo pair."""

    time_ns: int
    camera_from_world: Pose
    images: tuple[Image, ...]
    """Grey images of the camera, or of both cameras of a pair; their longer side is at most SEARCH_SIDE_PX."""
    reduction: float
    """Size of these images relative to the camera's."""
    covariance: Array | None = None
    """(6, 6) covariance of the left twist of camera_from_world."""
    motion: Array | None = None
    """(12,) motion of camera_from_world, see rolling.steady; only for a pair."""
    moving: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None
    """For one camera with a rolling shutter: positions (M, 2) [px] and velocities (M, 2) [px/s] of the tracks."""
    features: Features | None = None
    """Features of the first image, in pixels of the camera; None until they are needed."""
    descriptor: Descriptor | None = None
    """The descriptor of these features: after a fork the method may use another one."""
    segment: int = 0
    """The segment in whose world the pose is."""
    depth_sigma: float = 0.0
    """Standard deviation of ln depth of what it observes, in the unit of the segment; 0 for a pair."""

    @staticmethod
    def of(
        time_ns: int,
        camera_from_world: Pose,
        images: tuple[Image, ...],
        covariance: Array | None,
        motion: Array | None = None,
        moving: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None,
        segment: int = 0,
        depth_sigma: float = 0.0,
    ) -> Keyframe:
        """Returns a keyframe; large images are reduced to SEARCH_SIDE_PX."""
        height, width = images[0].shape
        reduction = min(1.0, SEARCH_SIDE_PX / max(height, width))
        if reduction < 1:
            size = (round(width * reduction), round(height * reduction))
            # Linear interpolation is fast, and a reduction by less than 2 causes little aliasing.
            images = tuple(np.asarray(cv2.resize(i, size, interpolation=cv2.INTER_LINEAR), np.uint8) for i in images)
        reduction = images[0].shape[1] / width
        return Keyframe(
            time_ns,
            camera_from_world,
            images,
            reduction,
            covariance,
            motion,
            moving,
            segment=segment,
            depth_sigma=depth_sigma,
        )

    @cached_property
    def appearance(self) -> NDArray[np.float32]:
        """Appearance of the first image, see `appearance_of`."""
        return appearance_of(self.images[0])

    def reduced(self, uv: Array) -> Array:
        """Converts pixels (N, 2) of the camera to pixels of the reduced images."""
        return (uv + 0.5) * self.reduction - 0.5

    def described(self, descriptor: Descriptor) -> Keyframe:
        """Returns the keyframe with features of this descriptor."""
        if self.is_described(descriptor):
            return self
        found = descriptor.detect_and_describe(self.images[0], FEATURES)
        uv = ((found.uv + 0.5) / self.reduction - 0.5).astype(np.float32)
        return replace(self, features=replace(found, uv=uv), descriptor=descriptor)

    def is_described(self, descriptor: Descriptor) -> bool:
        return self.features is not None and self.descriptor == descriptor


@dataclass(frozen=True, eq=False)
class KeyframeDatabase:
    """Immutable collection of keyframes: each change returns a new one."""

    keyframes: tuple[Keyframe, ...] = ()
    """Ordered by time."""

    def with_keyframe(self, keyframe: Keyframe) -> KeyframeDatabase:
        """Adds a keyframe; if there are too many, removes the older one whose neighbours are nearest to each other in
        time."""
        kept = (*self.keyframes, keyframe)
        if len(kept) > MAX_KEYFRAMES:
            gone = most_crowded([p.time_ns for p in kept[: MAX_KEYFRAMES - RECENT]])
            kept = (*kept[:gone], *kept[gone + 1 :])
        return KeyframeDatabase(kept)

    def with_poses(self, camera_from_world: Mapping[int, Pose]) -> KeyframeDatabase:
        """Replaces the poses of the keyframes at these times."""
        return KeyframeDatabase(
            tuple(
                replace(p, camera_from_world=camera_from_world[p.time_ns]) if p.time_ns in camera_from_world else p
                for p in self.keyframes
            )
        )

    def with_features(self, keyframe: Keyframe) -> KeyframeDatabase:
        """Stores the features of a keyframe; returns an unchanged copy if the keyframe is not in the database."""
        found = {"features": keyframe.features, "descriptor": keyframe.descriptor}
        return KeyframeDatabase(
            tuple(replace(k, **found) if k.time_ns == keyframe.time_ns else k for k in self.keyframes)
        )

    def at(self, time_ns: int) -> Keyframe | None:
        return next((p for p in self.keyframes if p.time_ns == time_ns), None)

    def neighbours(self, keyframe: Keyframe) -> tuple[Keyframe, ...]:
        """Returns some keyframes of the same segment before a keyframe; those after it if there are none before."""
        same = [k for k in self.keyframes if k.segment == keyframe.segment]
        i = sum(k.time_ns < keyframe.time_ns for k in same)
        index = [i - n for n in NEIGHBOURS if i >= n] or [i + n for n in NEIGHBOURS if i + n < len(same)]
        return tuple(same[j] for j in sorted(index))

    def query(self, grey: Image, turn: int) -> tuple[Keyframe, ...]:
        """Returns the newest keyframe and the CANDIDATES others most similar to an image; each further `turn`, counted
        from 0, returns the next ones."""
        others = self.keyframes[:-1]
        order = ranked(appearance_of(grey), [p.appearance for p in others])
        chosen = [order[(i + CANDIDATES * turn) % len(order)] for i in range(CANDIDATES)] if order else []
        return (*self.keyframes[-1:], *(others[i] for i in dict.fromkeys(chosen)))


def ranked(appearance: Array, others: Sequence[Array]) -> list[int]:
    """Returns the indices of the appearances, the most similar one first."""
    similarity = np.array([float((other * appearance).sum()) for other in others])
    return np.argsort(-similarity, kind="stable").tolist()


def most_crowded(positions: Sequence[float]) -> int:
    """Returns the index of the position whose neighbours are nearest to each other, never the first or the last one. It
    is the one to remove from a list that is too long."""
    along = np.asarray(positions)
    return 1 + int(np.argmin(along[2:] - along[:-2]))


def appearance_of(grey: Image) -> NDArray[np.float32]:
    """Returns the blurred image with mean 0 and norm 1: the inner product of two is their similarity."""
    small = cv2.GaussianBlur(cv2.resize(grey, COARSE_PX, interpolation=cv2.INTER_AREA).astype(np.float32), (0, 0), 1.0)
    small -= small.mean()
    return small / max(float(np.linalg.norm(small)), 1e-9)
