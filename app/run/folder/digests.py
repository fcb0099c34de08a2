"""Short fingerprints of arrays: equal bits, equal digest. By them runs are compared without keeping the arrays."""

from __future__ import annotations

from collections.abc import Callable
from hashlib import blake2b

import numpy as np

from ispom.types import Step


def digest(*arrays: np.ndarray) -> str:
    """Of shapes, kinds and bits, in this order: 16 hexadecimal digits; the same on machines of either byte order."""
    found = blake2b(digest_size=8)
    for array in arrays:
        little = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
        found.update(f"{little.dtype.str}{little.shape}".encode())
        found.update(little.data)
    return found.hexdigest()


def _tracks(step: Step) -> str:
    """Which tracks there are, where, and what became of them; not the residuals, which follow from the pose."""
    arrays = [(np.frombuffer(name.encode(), np.uint8), t.ids, t.uv, t.status) for name, t in step.tracks.items()]
    return digest(*(array for group in arrays for array in group)) if arrays else ""


def _landmarks(step: Step) -> str:
    points = step.landmarks
    return digest(points.ids, points.xyz_in_world) if len(points) else ""


def _revised(step: Step) -> str:
    poses = step.revised
    return digest(poses.times_ns, poses.rotations, poses.translations) if len(poses) else ""


def _covariance(step: Step) -> str:
    return "" if step.covariance is None else digest(step.covariance)


DIGESTS: dict[str, Callable[[Step], str]] = {
    "tracks_digest": _tracks,
    "covariance_digest": _covariance,
    "landmarks_digest": _landmarks,
    "revised_digest": _revised,
}
"""By column of steps.csv: of a step; empty where it has none of these."""
