"""Corners tracked through the images of one camera, and their positions in some of these: the keyframes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.calibration.tracked.scene import Observations
from ispom.features.klt import Klt
from ispom.features.shi_tomasi import at_subpixel, detect_spread
from ispom.geometry import Array
from ispom.types import Image, TrackStatus

SIDE_PX = 1280
"""Images whose longer side is longer are halved until it is not."""
CORNERS = 500
DISTANCE_SHARE = 0.01
"""Distance of corners, as a share of the image's longer side."""
MOVED_SHARE = 0.03
"""Median motion of all tracks, as a share of the image's longer side, that makes an image a keyframe,"""
LEFT_SHARE = 0.6
"""or where a smaller share of the last one's tracks is left."""
CORNER_PX, CORNER_STEPS = 4, 30
SAME_PX = 3.0
"""Largest difference of the positions of one corner by two methods."""
STILL_PX = 0.25
"""A corner that moves less than this while half of the others move by MOVED_SHARE is not part of the scene, but a
letter or a logo on the image, or dirt on the lens. What is far ahead on a straight path moves as little in a few
pixels only."""
LEAST_VIEWS = 3
"""Least number of keyframes of a corner."""
LEAST_JOINED = 8
"""Points by which a keyframe is joined to those before it: with fewer its pose is not known."""


@dataclass(frozen=True, eq=False)
class Tracks:
    """Observations, sorted by point, those of a point by view."""

    size: tuple[int, int]
    """(width, height) [px] of the images in which corners were tracked,"""
    factor: float
    """which are the camera's, reduced by this."""
    views: NDArray[np.int64]
    """(V,) which images the keyframes are."""
    view: NDArray[np.int64]
    """(K,) index of the view, 0 to V - 1."""
    point: NDArray[np.int64]
    """(K,) index of the point, 0 to M - 1."""
    uv: Array
    """(K, 2) [px] in the reduced images."""
    images: tuple[Image, ...] = ()
    """(H, W) each, of the keyframes, reduced; none where the tracks come from elsewhere."""

    def in_views(self, first: int, end: int) -> Tracks:
        """Returns the observations in these views only; views and points keep their numbers."""
        mine = (self.view >= first) & (self.view < end)
        return replace(self, view=self.view[mine], point=self.point[mine], uv=self.uv[mine])

    def joined(self) -> Tracks:
        """Returns the keyframes up to the first one that is not joined to those before it, as after a jump or a bare
        wall."""
        first = np.full(self.points, len(self.views))
        np.minimum.at(first, self.point, self.view)
        shared = np.bincount(self.view[self.view > first[self.point]], minlength=len(self.views))
        unjoined = np.flatnonzero(shared[1:] < LEAST_JOINED)
        if not len(unjoined):
            return self
        end = int(unjoined[0]) + 1
        return replace(self.in_views(0, end), views=self.views[:end], images=self.images[:end])

    @property
    def observations(self) -> Observations:
        """All of them, as `scene` has them."""
        return Observations(self.view, self.point, self.uv)

    @property
    def points(self) -> int:
        return int(self.point.max()) + 1 if len(self.point) else 0


def key_tracks(images: Iterable[Image], most_views: int) -> Tracks:
    """Tracks corners from image to image (H, W) or (H, W, 3) until there are enough keyframes, or no more images."""
    klt = Klt()
    last: Image | None = None
    key: Image | None = None
    factor, ids, uv, at_key, next_id = 1.0, np.zeros(0, np.int64), np.zeros((0, 2), np.float32), None, 0
    count_at_key = 0
    views: list[int] = []
    kept: list[Image] = []
    rows: list[tuple[NDArray[np.int64], Array]] = []
    for i, image in enumerate(images):
        grey, factor = _reduced(image)
        if last is not None:
            uv, status = klt.track(last, grey, uv)
            alive = status == TrackStatus.ALIVE
            ids, uv = ids[alive], uv[alive]
            at_key = at_key[alive] if at_key is not None else None
        last = grey
        if at_key is not None:
            lengths = np.linalg.norm(uv - at_key, axis=1)
            moved = len(ids) > 0 and float(np.median(lengths)) >= MOVED_SHARE * max(grey.shape)
            if not moved and len(ids) >= LEFT_SHARE * count_at_key:
                continue
            if moved:
                moves = lengths > STILL_PX
                ids, uv, at_key = ids[moves], uv[moves], at_key[moves]
        if key is not None and at_key is not None:  # from one keyframe to the next: less drift than over all images
            retracked, status = klt.track(key, grey, at_key, uv)
            same = (status == TrackStatus.ALIVE) & (np.linalg.norm(retracked - uv, axis=1) < SAME_PX)
            ids, uv = ids[same], retracked[same]
        new = _corners(grey, uv)
        ids = np.concatenate([ids, next_id + np.arange(len(new))])
        uv, next_id = np.concatenate([uv, new]), next_id + len(new)
        key, at_key, count_at_key = grey, uv, len(uv)
        views.append(i)
        kept.append(grey)
        rows.append((ids, uv.astype(float)))
        if len(views) == most_views:
            break
    size = (0, 0) if last is None else (last.shape[1], last.shape[0])
    return replace(_sorted(size, factor, views, rows), images=tuple(kept))


def _corners(grey: Image, taken: NDArray[np.float32]) -> NDArray[np.float32]:
    """Detects new corners (M, 2)."""
    found = detect_spread(grey, CORNERS, taken, DISTANCE_SHARE * max(grey.shape))
    exact = at_subpixel(grey, found, CORNER_PX, CORNER_STEPS)
    return exact[np.linalg.norm(exact - found, axis=1) < SAME_PX]


def _reduced(image: Image) -> tuple[Image, float]:
    """Grey, and by which factor the size was reduced."""
    grey = image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
    factor = 1
    while max(grey.shape) > SIDE_PX * factor:
        factor *= 2
    if factor == 1:
        return grey, 1.0
    height, width = grey.shape[0] // factor, grey.shape[1] // factor
    reduced = cv2.resize(grey[: height * factor, : width * factor], (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(reduced, np.uint8), 1 / factor


def _sorted(
    size: tuple[int, int], factor: float, views: list[int], rows: list[tuple[NDArray[np.int64], Array]]
) -> Tracks:
    view = np.concatenate([np.full(len(ids), v) for v, (ids, _) in enumerate(rows)] or [np.zeros(0, np.int64)])
    ids = np.concatenate([ids for ids, _ in rows] or [np.zeros(0, np.int64)])
    uv = np.concatenate([uv for _, uv in rows] or [np.zeros((0, 2))])
    _, owner, counts = np.unique(ids, return_inverse=True, return_counts=True)
    often = counts >= LEAST_VIEWS
    number = np.cumsum(often) - 1
    keep = often[owner]
    view, owner, uv = view[keep], number[owner[keep]], uv[keep]
    order = np.lexsort((view, owner))
    return Tracks(size, factor, np.array(views, np.int64), view[order], owner[order], uv[order])
