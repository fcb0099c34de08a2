"""The judge's own tracks through a recording, in normalised coordinates: no estimator uses them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ispom.evaluation.doctor.examination import grey, halvings
from ispom.evaluation.doctor.tracking import evened, followed
from ispom.features.interfaces import Features
from ispom.features.sift import SIFT, SIFT_MATCHER
from ispom.geometry import Array
from ispom.types import Camera, Frame, FrameName, Image, Sequence

from .pairs import TwoViews

LONGEST_SPAN = 16
"""Frames between the two of a pair, at most: tracks become few, and the answer no longer local."""
FEATURES = 1500
"""Number of features of an image that are matched: a second witness in addition to the tracks."""
CHUNK = 96
"""Frames that are tracked at a time, which limits memory; the next chunk begins early enough for its first pairs."""


@dataclass(frozen=True, eq=False)
class Chunk:
    """P corners in F consecutive frames of the main camera."""

    first: int
    """Number of its first frame among those of the main camera."""
    fresh: int
    """Number of its first frames that begin pairs. Pairs that begin at later frames are in the next chunk."""
    x: Array
    """(P, F, 2) in normalised coordinates; NaN where a corner is not seen."""
    pixel: float
    """Size of a pixel of the tracked images in normalised coordinates."""
    matches: Callable[[int, int], TwoViews] | None = None
    """Matches of features of two of the F frames, found without the tracks; None where there are no images."""
    _views: dict[tuple[int, int], TwoViews] = field(default_factory=dict[tuple[int, int], TwoViews], repr=False)

    def views(self, first: int, second: int) -> TwoViews:
        """Returns the tracks that two of the F frames share; the same object for the same frames."""
        known = self._views.get((first, second))
        if known is None:
            both = np.isfinite(self.x[:, first, 0]) & np.isfinite(self.x[:, second, 0])
            known = self._views[first, second] = TwoViews(self.x[both, first], self.x[both, second], self.pixel)
        return known


def main_camera(sequence: Sequence) -> FrameName:
    """Returns the camera in whose images corners are tracked."""
    return "video" if sequence.rig.video is not None else "left"


def main_frames(sequence: Sequence) -> NDArray[np.int64]:
    """Returns the places (F,) of the main camera's frames among the measurements."""
    kind = "video" if main_camera(sequence) == "video" else "stereo"
    return np.array([i for i, each in enumerate(sequence.kinds) if each == kind], np.int64)


def chunks(sequence: Sequence, places: NDArray[np.int64], advance: Callable[[], None]) -> Iterator[Chunk]:
    """Tracks corners through the frames at these places, a chunk at a time. `advance` is called after each frame."""
    name = main_camera(sequence)
    camera = sequence.rig.camera(name)
    count = halvings(camera.longer_side_px)
    camera = camera.scaled(0.5**count) if count else camera

    def image(place: int) -> Image:
        measured = sequence.load(place)
        if not isinstance(measured, Frame):
            raise TypeError(f"measurement {place} is no frame")
        advance()
        return evened(grey(measured.images[name], count))

    images: list[Image] = []
    for first in range(0, len(places), CHUNK):
        images = images[CHUNK:]
        end = min(first + CHUNK + LONGEST_SPAN, len(places))
        images += [image(int(place)) for place in places[first + len(images) : end]]
        uv, _ = followed(images)
        seen = np.isfinite(uv[..., 0])
        x = np.full(uv.shape, np.nan)
        x[seen] = _normalised(camera, uv[seen])
        yield Chunk(first, min(CHUNK, len(images)), x, 1 / camera.fx, _matcher(tuple(images), camera))


def _normalised(camera: Camera, uv: Array) -> Array:
    """Pixels (N, 2) in normalised coordinates; NaN where a ray does not lead forwards."""
    rays, valid = camera.unproject(uv)
    forwards = (valid & (rays[:, 2] > 0.1))[:, None]
    return np.where(forwards, rays[:, :2] / np.maximum(rays[:, 2:], 0.1), np.nan)


def _matcher(images: tuple[Image, ...], camera: Camera) -> Callable[[int, int], TwoViews]:
    """Returns the matches of two of the images, whose features are found once."""

    @cache
    def features(place: int) -> Features:
        return SIFT.detect_and_describe(images[place], FEATURES)

    def matches(first: int, second: int) -> TwoViews:
        a, b = features(first), features(second)
        which = SIFT_MATCHER.match(a, b)
        x1, x2 = (_normalised(camera, each.uv[which[:, k]].astype(float)) for k, each in enumerate((a, b)))
        good = np.isfinite(x1[:, 0]) & np.isfinite(x2[:, 0])
        return TwoViews(x1[good], x2[good], 1 / camera.fx)

    return matches
