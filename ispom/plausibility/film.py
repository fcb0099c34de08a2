"""Whether the images of a film follow each other as a moving camera takes them: cuts, titles and repeated images.

Neighbouring images are compared as thumbnails of one brightness and contrast. A camera's motion changes them from
image to image by amounts that are alike, so that one change that is far larger than those around it is none.
"""

from __future__ import annotations

from array import array

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.plausibility.doubt import Doubt
from ispom.types import Image, as_grey

SIDE = 48
"""Longer side of thumbnails [px]: features that a hand's tremble moves are averaged out."""
BEFORE_AND_AFTER = 6
"""Number of changes before a change, and after it, with which it is compared."""
CUT, CUT_LEVEL = 2.5, 0.2
"""A cut is a change of at least this multiple of the largest of those, and of at least this share of the contrast. The
largest change in 20 real recordings without a cut was 1.6 times the others."""
STILL, LEAST_STILL = 0.01, 3
"""Share of the contrast by which images change less where nothing moves, and the least number of such changes in a row
that make a title. Codecs change still images by a thousandth."""
REPEATED, LEAST_REPEATED, MOVING = 0.05, 3, 0.03
"""An image is repeated where it changes by less than this share of the usual change. Repeated images are reported from
this number on, and in films that usually change by more than this share of their contrast."""
EVEN = 1.5
"""Images are missing, as their times say, where an interval is longer than this many usual ones."""


def thumbnail(image: Image) -> Array:
    """Returns a small image (H, W) of mean 0 and standard deviation 1; of an even image 0."""
    share = SIDE / max(image.shape[:2])
    size = max(4, round(image.shape[1] * share)), max(4, round(image.shape[0] * share))
    small = cv2.resize(as_grey(image), size, interpolation=cv2.INTER_AREA).astype(float)
    deviation = small.std()
    return (small - small.mean()) / deviation if deviation > 1 else np.zeros_like(small)


class Film:
    """The changes between neighbouring images of a film, of which it keeps the last one only."""

    def __init__(self) -> None:
        self._last: Array | None = None
        self._changes = array("d")
        self._times_ns = array("q")

    def __len__(self) -> int:
        return len(self._times_ns)

    def add(self, image: Image, time_ns: int) -> None:
        """The next image, (H, W) or (H, W, 3), taken at this time."""
        small = thumbnail(image)
        if self._last is not None:
            alike = self._last.shape == small.shape
            self._changes.append(float(np.abs(small - self._last).mean()) if alike else 0.0)
        self._last = small
        self._times_ns.append(time_ns)

    def doubts(self, where: str, removable: bool = False) -> tuple[tuple[Doubt, ...], int]:
        """Returns doubts about the images so far, one of each kind, and the number of images of a title at their begin,
        which are left out where they are `removable`."""
        return _doubts(where, np.array(self._changes), np.array(self._times_ns, np.int64), removable)


def _doubts(where: str, changes: Array, times_ns: NDArray[np.int64], removable: bool) -> tuple[tuple[Doubt, ...], int]:
    if len(times_ns) < BEFORE_AND_AFTER:
        return (), 0
    steps_ns = np.diff(times_ns)
    even = steps_ns <= EVEN * np.median(steps_ns)
    cuts = [k for k in range(len(changes)) if _is_cut(changes, k)]
    titles = [(first, last) for first, last in _stills(changes) if first - 1 in cuts or last in cuts]
    out, begin = list[Doubt](), 0
    if titles:
        first, last = titles[0]
        begin = last + 1 if removable and first == 0 else 0
        side = "after" if last in cuts else "before"
        text = f"{where}: images {first} to {last} are the same, and a cut is {side} them"
        cure = "they are left out" if begin else "cut it out, and give the parts of the film on their own"
        out.append(Doubt("images_title", f"{text}: this looks like a title; {cure}."))
    edges = {edge for first, last in titles for edge in (first - 1, last)}
    cuts = [k for k in cuts if k not in edges and even[k]]
    if cuts:
        k = cuts[0]
        usual = np.median(_around(changes, k))
        times = changes[k] / max(usual, STILL)
        text = f"{where}: image {k + 1} differs from the one before {times:.2g} times as much as its neighbours"
        what = "this looks like a cut, or like images that are missing while the times go on"
        what = f"so do {len(cuts) - 1} others; {what}" if len(cuts) > 1 else what
        out.append(Doubt("images_cut", f"{text}: {what}; split the film there, or give the times of its images."))
    usual = float(np.median(changes))
    in_stills = {k for first, last in _stills(changes) for k in range(first, last)}
    same = [k for k in np.flatnonzero(changes < REPEATED * usual).tolist() if k not in in_stills]
    if usual > MOVING and len(same) >= LEAST_REPEATED:
        text = f"{where}: {len(same)} of {len(times_ns)} images repeat the one before, first image {same[0] + 1}"
        out.append(Doubt("images_repeated", f"{text}: this looks like a camera that is read too often; remove them."))
    return tuple(out), begin


def _around(changes: Array, k: int) -> Array:
    return np.concatenate([changes[max(0, k - BEFORE_AND_AFTER) : k], changes[k + 1 : k + 1 + BEFORE_AND_AFTER]])


def _is_cut(changes: Array, k: int) -> bool:
    return bool(changes[k] >= CUT_LEVEL and changes[k] >= CUT * _around(changes, k).max())


def _stills(changes: Array) -> list[tuple[int, int]]:
    """Returns the first and the last image of each run of images that are the same."""
    out, first = list[tuple[int, int]](), None
    for k, still in enumerate([*(changes < STILL).tolist(), False]):
        if still and first is None:
            first = k
        if not still and first is not None:
            if k - first >= LEAST_STILL:
                out.append((first, k))
            first = None
    return out
