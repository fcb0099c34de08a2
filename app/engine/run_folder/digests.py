"""Digests of arrays: equal bits have equal digests. They compare runs without the arrays."""

from __future__ import annotations

from collections.abc import Callable
from hashlib import blake2b

import numpy as np

from ispom.types import Step, Tracks, TrackStatus


def digest(*arrays: np.ndarray) -> str:
    """Returns a digest of shapes, kinds and bits, in this order: 16 hexadecimal digits that do not depend on the byte
    order of the machine."""
    found = blake2b(digest_size=8)
    for array in arrays:
        little = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
        found.update(f"{little.dtype.str}{little.shape}".encode())
        found.update(little.data)
    return found.hexdigest()


def _followed(step: Step) -> str:
    """Returns the digest of the positions of tracks that existed before, without residuals, which follow from the
    pose."""
    return _of_tracks(step, lambda t: (t.ids[_old(t)], t.uv[_old(t)]))


def _fates(step: Step) -> str:
    """Returns the digest of the status of tracks and of new tracks, which depend on checks."""
    return _of_tracks(step, lambda t: (t.status, t.ids[~_old(t)], t.uv[~_old(t)]))


def _old(tracks: Tracks) -> np.ndarray:
    return tracks.status != TrackStatus.NEW


def _of_tracks(step: Step, arrays_of: Callable[[Tracks], tuple[np.ndarray, ...]]) -> str:
    groups = ((np.frombuffer(name.encode(), np.uint8), *arrays_of(tracks)) for name, tracks in step.tracks.items())
    return digest(*(array for group in groups for array in group)) if step.tracks else ""


def _landmarks(step: Step) -> str:
    points = step.landmarks
    return digest(points.ids, points.xyz_in_world) if len(points) else ""


def _revised(step: Step) -> str:
    poses = step.revised
    return digest(poses.times_ns, poses.rotations, poses.translations) if len(poses) else ""


def _covariance(step: Step) -> str:
    return "" if step.covariance is None else digest(step.covariance)


DIGESTS: dict[str, Callable[[Step], str]] = {
    "tracks_digest": _followed,
    "fates_digest": _fates,
    "covariance_digest": _covariance,
    "landmarks_digest": _landmarks,
    "revised_digest": _revised,
}
"""By column of steps.csv: the function that computes the digest of a step; empty where the step has no such arrays."""
