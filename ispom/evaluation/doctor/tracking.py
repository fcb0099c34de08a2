"""Corners tracked through the main camera's frames and into the stereo pairs, by the doctor itself: no estimator uses
these tracks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.cameras import resampling
from ispom.features.klt import Klt
from ispom.geometry import Array
from ispom.types import Image, TrackStatus

from .stretch import Shot, Stretch

MOST = 160
"""Largest number of corners that are tracked at a time."""
APART_PX = 8
TRACKER = Klt(window_px=15, levels=3, iterations=30, max_forward_backward_px=0.4, border_px=2, back_from_guess=True)
FROM_LEFT = replace(TRACKER, levels=2)
"""Tracker from the left into the right image, where the search starts near."""
GUESSES = (0.01, 0.035, 0.07, 0.12, 0.18, -0.02, -0.05, -0.1)
"""Disparities from which the search in the right image starts, relative to its width; negative ones where left and
right are exchanged."""
QUALITY = 0.01
"""Least quality of corners, relative to the best one (Shi and Tomasi)."""
MEAN, STD = 110.0, 45.0
"""Images are brought to this mean and contrast before they are compared: an exposure that jumps costs no tracks."""


@dataclass(frozen=True, eq=False)
class Tracked:
    """P corners in F main frames and Q pairs; NaN where a corner is not seen."""

    uv: Array
    """(P, F, 2) in the main camera."""
    left: Array
    """(P, Q, 2)"""
    right: Array
    """(P, Q, 2)"""
    survived: NDArray[np.float64]
    """(F - 1,) share of the corners that are tracked from a frame to the next."""

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(P, F)"""
        return np.isfinite(self.uv[..., 0])


def track(seen: Stretch) -> Tracked:
    """Tracks corners through the main camera's frames, and into the pairs."""
    uv, survived = followed([evened(shot.images[seen.main]) for shot in seen.main_shots])
    left, right = _in_pairs(seen, uv)
    return Tracked(uv, left, right, survived)


def followed(images: Sequence[Image]) -> tuple[Array, NDArray[np.float64]]:
    """Returns corners (P, F, 2) tracked through F evened images, NaN where a corner is not seen, and the share
    (F - 1,) of them that is tracked from an image to the next; new ones are detected where an image has too few."""
    tracks: list[Array] = []
    live: list[int] = []
    survived: list[float] = []
    for f, image in enumerate(images):
        if f and live:
            before = np.array([tracks[i][f - 1] for i in live], np.float32)
            now, status = TRACKER.track(images[f - 1], image, before)
            good = status == TrackStatus.ALIVE
            survived.append(float(good.mean()))
            for i, uv in zip(np.array(live)[good].tolist(), now[good], strict=True):
                tracks[i][f] = uv
            live = np.array(live)[good].tolist()
        elif f:
            survived.append(0.0)
        if len(live) < 0.8 * MOST:
            known = np.array([tracks[i][f] for i in live], np.float32).reshape(-1, 2)
            for uv in corners(image, known, MOST - len(live)):
                live.append(len(tracks))
                tracks.append(np.full((len(images), 2), np.nan))
                tracks[-1][f] = uv
    return np.array(tracks).reshape(-1, len(images), 2), np.array(survived)


def evened(image: Image) -> Image:
    """Returns the image with the usual mean and contrast."""
    mean, std = (float(v[0, 0]) for v in cv2.meanStdDev(image))
    table = np.clip((np.arange(256) - mean) * (STD / max(std, 1.0)) + MEAN + 0.5, 0, 255).astype(np.uint8)
    return np.asarray(cv2.LUT(image, table), np.uint8)


def corners(image: Image, known: Array, count: int) -> Array:
    """Returns at most `count` corners (N, 2) away from the known ones."""
    mask = np.full(image.shape, 255, np.uint8)
    for x, y in known:
        cv2.circle(mask, (round(float(x)), round(float(y))), APART_PX, 0, -1)
    found = cv2.goodFeaturesToTrack(image, max(count, 1), QUALITY, APART_PX, mask=mask)
    return np.zeros((0, 2), np.float32) if found is None else np.asarray(found, np.float32).reshape(-1, 2)


def _in_pairs(seen: Stretch, uv: Array) -> tuple[Array, Array]:
    pairs = seen.pairs if seen.rig.has_stereo else ()
    left, right = np.full((2, len(uv), len(pairs), 2), np.nan)
    times_ns = np.array([shot.time_ns for shot in seen.main_shots])
    if not len(times_ns):
        return left, right
    for q, pair in enumerate(pairs):
        f = int(np.abs(times_ns - pair.time_ns).argmin())
        here = np.flatnonzero(np.isfinite(uv[:, f, 0]))
        at, good = _in_left(seen, seen.main_shots[f], pair, uv[here, f])
        here, at = here[good], at[good]
        there, good = _in_right(evened(pair.images["left"]), evened(pair.images["right"]), at)
        left[here, q] = at
        right[here[good], q] = there[good]
    return left, right


def _in_left(seen: Stretch, shot: Shot, pair: Shot, uv: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Finds positions (N, 2) of the main camera in the left image.

    The left image is resampled as the video camera would see it from there; the result does not depend on whether
    the calibration is right, as the same one maps there and back.
    """
    if seen.main == "left":
        return uv, np.ones(len(uv), bool)
    video, left = seen.rig.camera("video"), seen.rig.camera("left")
    turn = (seen.rig.rig_from_left.inverse() @ seen.rig.rig_from_video).rotation
    maps = resampling(left, video, turn)
    warped = cv2.remap(pair.images["left"], *maps, cv2.INTER_AREA, borderMode=cv2.BORDER_REPLICATE)
    warped = evened(np.asarray(warped, np.uint8))
    there, status = TRACKER.track(evened(shot.images["video"]), warped, np.asarray(uv, np.float32))
    rays, valid = video.unproject(there)
    return left.project(rays @ turn.T), (status == TrackStatus.ALIVE) & valid


def _in_right(left: Image, right: Image, uv: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Finds positions of the left image in the right one: of several starts, the one whose patch is most similar."""
    best, uv = np.full(len(uv), np.inf), np.asarray(uv, np.float32)
    found, good = np.zeros((len(uv), 2), np.float32), np.zeros(len(uv), bool)
    for guess in GUESSES:
        there, status = FROM_LEFT.track(left, right, uv, uv - np.array([guess * left.shape[1], 0], np.float32))
        error = np.where(status == TrackStatus.ALIVE, _difference(left, right, uv, there), np.inf)
        better = error < best - 1e-6
        best[better], found[better], good[better] = error[better], there[better], True
    return found, good


def _difference(a: Image, b: Image, uv: Array, there: Array) -> Array:
    """Returns the mean absolute differences (N,) of patches of 11 pixels."""
    side = np.arange(-5, 6, dtype=np.float32)
    dx, dy = np.meshgrid(side, side)

    def patches(image: Image, at: Array) -> Array:
        x, y = (np.asarray(at[:, k, None], np.float32) + d.reshape(1, -1) for k, d in ((0, dx), (1, dy)))
        return cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)

    return np.abs(patches(a, uv) - patches(b, there)).mean(axis=1) if len(uv) else np.zeros(0)
