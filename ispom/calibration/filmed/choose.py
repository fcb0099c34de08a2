"""Which frames of a film a calibration is made of: sharp ones that show something new."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.calibration.filmed.images import Source, nearest
from ispom.calibration.motion.course import LONGEST_S
from ispom.errors import UnreadableImage
from ispom.types import Image

LOOKED_AT = 600
"""Frames of a film that are looked at, evenly over its length."""
THUMBNAIL = (64, 48)
NEW = 6.0
"""Mean difference [grey levels] of thumbnails, after their means are subtracted, from which on a frame is new."""
WINDOW = 5
"""Number of successive frames of which only the sharpest is used; fewer where a film has not many frames."""

NEIGHBOURS = 2
"""Images before an image, and as many after it, that show how the camera moved in it."""
MOST_MOVING = 40
"""Most images for which the motion of the camera is measured by their neighbours."""


def best_frames(source: Source, most: int, step: Callable[[], None] = lambda: None) -> list[int]:
    """Returns increasing indices of at most `most` images; of a folder with no more images, all of them. `step` is
    called after each image that is examined."""
    if not source.is_film and len(source) <= most:
        return list(range(len(source)))
    looked = np.unique(np.linspace(0, len(source) - 1, min(len(source), LOOKED_AT)).astype(int))
    sharpness, small = np.zeros(len(looked)), np.zeros((len(looked), THUMBNAIL[1], THUMBNAIL[0]), np.float32)
    for k, i in enumerate(looked):
        try:
            image = source.read(int(i))
        except UnreadableImage:
            continue
        sharpness[k], small[k] = _sharpness(image), _thumbnail(image)
        step()
    window = max(1, min(WINDOW, len(looked) // most))
    groups = [np.arange(a, min(a + window, len(looked))) for a in range(0, len(looked), window)]
    best = [int(group[sharpness[group].argmax()]) for group in groups]
    new: list[int] = []
    for k in best:
        if sharpness[k] > 0 and (not new or min(_difference(small[k], small[j]) for j in new[-3:]) > NEW):
            new.append(k)
    if len(new) > most:
        new = [new[j] for j in np.unique(np.linspace(0, len(new) - 1, most).astype(int))]
    return [int(looked[k]) for k in new]


def near(video: Source, left: Source, within_s: float) -> Source:
    """Returns the images of a video whose times differ from one of the left camera's by at most `within_s`.

    Raises ValueError where one of them has no times.
    """
    if video.times_ns is None or left.times_ns is None:
        raise ValueError("images without times cannot be near each other in time: give images with time stamps")
    away_ns = np.abs(left.times_ns[nearest(left.times_ns, video.times_ns)] - video.times_ns)
    return video.select(np.flatnonzero(away_ns <= within_s * 1e9).tolist())


def around(source: Source, chosen: Source) -> Source | None:
    """Returns the images right before and after some of those that were chosen of a source, and these: they show how
    the camera moved. None where times are not known, or differ too much for that."""
    if source.times_ns is None or chosen.times_ns is None or len(source) < 2 or not len(chosen):
        return None
    if float(np.median(np.diff(source.times_ns))) * 1e-9 > LONGEST_S:
        return None
    some = np.unique(np.linspace(0, len(chosen) - 1, min(len(chosen), MOST_MOVING)).astype(int))
    at = np.searchsorted(source.times_ns, chosen.times_ns[some])
    index = np.unique(np.clip(at[:, None] + np.arange(-NEIGHBOURS, NEIGHBOURS + 1), 0, len(source) - 1))
    return source.select(index.tolist())


def _sharpness(image: Image) -> float:
    """Variance of the Laplacian, of an image of at most 640 px."""
    factor = min(1.0, 640 / max(image.shape))
    small = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    return float(cv2.Laplacian(small, cv2.CV_32F).var())


def _thumbnail(image: Image) -> NDArray[np.float32]:
    small = cv2.resize(image, THUMBNAIL, interpolation=cv2.INTER_AREA).astype(np.float32)
    return small - small.mean()


def _difference(one: NDArray[np.float32], other: NDArray[np.float32]) -> float:
    return float(np.abs(one - other).mean())
