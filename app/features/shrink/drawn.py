"""Images that show tracked points only: for a recording that may not be given away.

Each track is a patch of texture of its own, drawn where it was tracked. What the recording showed is not in them: only
the positions of corners.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.types import Frame, FrameName, Image, Measurement, Sequence, Tracks, TrackStatus

from ...engine.events import Stepped

GREY = 128
"""Where no track is."""
HALF_PX = 10
"""Half of a patch: it covers the windows of 21 pixels in which tracks are usually followed."""
GRAIN_PX, CONTRAST = 1.5, 60.0
"""Size of the texture's grains, which are corners of a few pixels, and its standard deviation in grey levels."""
Points = Mapping[tuple[int, FrameName], tuple[NDArray[np.int64], Array]]
"""By time [ns] and camera: ids (N,) and positions (N, 2) [px] of the drawn points."""


def points_of(steps: Iterable[Stepped], method: str) -> dict[tuple[int, FrameName], tuple[NDArray[np.int64], Array]]:
    """Returns where a method tracked points; in the right camera where it knows their disparity."""
    found: dict[tuple[int, FrameName], tuple[NDArray[np.int64], Array]] = {}
    for stepped in steps:
        for step in stepped.steps:
            for camera, tracks in step.tracks.items() if step.method == method else ():
                found[step.time_ns, camera] = _living(tracks)
                if camera == "left":
                    found[step.time_ns, "right"] = _in_right(tracks)
    return found


def drawn(part: Sequence, points: Points) -> Sequence:
    """Returns the sequence with points in place of its images, which are grey."""

    def load(i: int) -> Measurement:
        measured = part.load(i)
        if not isinstance(measured, Frame):
            return measured
        images = {
            name: _image(
                image.shape[:2], *points.get((measured.time_ns, name), (np.zeros(0, np.int64), np.zeros((0, 2))))
            )
            for name, image in measured.images.items()
        }
        return replace(measured, images=images)

    return replace(part, load=load)


def _living(tracks: Tracks) -> tuple[NDArray[np.int64], Array]:
    alive = (tracks.status < TrackStatus.LOST) & np.isfinite(tracks.uv).all(axis=1)
    return tracks.ids[alive], tracks.uv[alive].astype(float)


def _in_right(tracks: Tracks) -> tuple[NDArray[np.int64], Array]:
    alive = (tracks.status < TrackStatus.LOST) & np.isfinite(tracks.uv).all(axis=1) & np.isfinite(tracks.disparity_px)
    return tracks.ids[alive], tracks.uv[alive] - np.stack([tracks.disparity_px[alive], np.zeros(alive.sum())], axis=1)


def _image(size: tuple[int, int], ids: NDArray[np.int64], uv: Array) -> Image:
    """Draws patches, the later ones over the earlier ones. `size` is (height, width)."""
    height, width = size
    out = np.full((height, width), float(GREY))
    for identity, (u, v) in zip(ids.tolist(), uv, strict=True):
        x, y = int(np.floor(u)), int(np.floor(v))
        texture, opacity = _patch(identity)
        moved = np.array([[1, 0, u - x], [0, 1, v - y]])
        patch, weight = (
            cv2.warpAffine(each, moved, each.shape[::-1], flags=cv2.INTER_LINEAR) for each in (texture, opacity)
        )
        half = texture.shape[0] // 2
        left, top = max(x - half, 0), max(y - half, 0)
        right, bottom = min(x + half + 1, width), min(y + half + 1, height)
        if left >= right or top >= bottom:
            continue
        rows, columns = slice(top - y + half, bottom - y + half), slice(left - x + half, right - x + half)
        place, a = out[top:bottom, left:right], weight[rows, columns]
        place += a * (GREY + patch[rows, columns] - place)
    return np.clip(np.rint(out), 0, 255).astype(np.uint8)


@lru_cache(maxsize=4096)
def _patch(identity: int) -> tuple[Array, Array]:
    """Returns texture and opacity of a track, with a free margin for a part of a pixel."""
    rng = np.random.default_rng(identity % (1 << 63))
    size = 2 * (HALF_PX + 1) + 1
    texture = cv2.GaussianBlur(rng.normal(size=(size, size)), (0, 0), GRAIN_PX)
    texture *= CONTRAST / texture.std()
    away = np.abs(np.arange(size) - size // 2)
    inside = np.clip(HALF_PX - away, 0, 3) / 3  # fades within three pixels, for an edge would be a corner of its own
    return texture, np.outer(inside, inside)
