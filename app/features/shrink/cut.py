"""A clip as a sequence: measurements of a recording that are left out, images that are made smaller."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.methods import kinds_of
from ispom.sequences import MIN_FRAMES
from ispom.types import FRAME_KINDS, Frame, Image, Kind, Measurement, Rig, Sequence

from .search import Clip

WRITABLE: tuple[Kind, ...] = ("stereo", "video")
"""Kinds of frames that a folder with a sequence.yaml holds."""
SENSORS: dict[Kind, tuple[str, ...]] = {"video": ("video",), "stereo": ("left", "right")}
"""Names of the cameras of each of them in the rig."""

LEAST_PX = 24
"""Least width and height of an image: in a smaller one the window of a tracked corner, of 21 pixels, does not fit."""


def cameras_of(sequence: Sequence) -> tuple[Kind, ...]:
    """Returns the kinds of its frames. Raises InputError for one that cannot be written."""
    kinds = tuple(kind for kind in sorted(FRAME_KINDS) if kind in sequence.kinds)
    others = [kind for kind in kinds if kind not in WRITABLE]
    if others or not kinds:
        what = "frames of several cameras with names of their own" if others else "no frames of a camera"
        raise InputError(f"{sequence.name} has {what}: give a recording of a video camera or of a pair")
    return kinds


def frame_times(sequence: Sequence) -> NDArray[np.int64]:
    """Returns the times (F,) [ns] at which any camera has a frame: those that a clip numbers."""
    return np.unique(sequence.times_ns[np.array([kind in FRAME_KINDS for kind in sequence.kinds], bool)])


def cut(whole: Sequence, clip: Clip) -> Sequence:
    """Returns the clip of a recording. It has no ground truth, and of other sensors what the methods use of them.

    Raises InputError for fewer frames than a source may have, and for images that cannot be made smaller.
    """
    times_ns = frame_times(whole)[list(clip.frames)]
    own, used = set(times_ns.tolist()), kinds_of(clip.methods)
    chosen = [
        i
        for i, (time_ns, kind) in enumerate(zip(whole.times_ns.tolist(), whole.kinds, strict=True))
        if (kind in clip.cameras and time_ns in own)
        or (kind not in FRAME_KINDS and kind in used and times_ns[0] <= time_ns <= times_ns[-1])
    ]
    there = Counter(kind for i in chosen if (kind := whole.kinds[i]) in FRAME_KINDS)
    if max(there.values(), default=0) < MIN_FRAMES:
        raise InputError(f"{whole.name} has fewer than {MIN_FRAMES} frames in this part, which no source may have")
    names = {name for kind in there for name in SENSORS[kind]}
    part = replace(whole.selected(chosen), truth=None)
    dropped = {
        name: None
        for name, sensor in part.rig.sensors.items()
        if (name not in names if name in part.rig.cameras else sensor.kind not in used)
    }
    return _smaller(replace(part, rig=part.rig.changed(**dropped)), 0.5**clip.halvings)


def _smaller(part: Sequence, factor: float) -> Sequence:
    """The same with images and cameras of another size."""
    if factor == 1:
        return part
    if factor * min(min(camera.width, camera.height) for camera in part.rig.cameras.values()) < LEAST_PX:
        raise InputError(f"{part.name} has images that cannot be halved again, to less than {LEAST_PX} pixels")
    rig = part.rig.changed(**{name: camera.scaled(factor) for name, camera in part.rig.cameras.items()})
    guess = part.guess and replace(part.guess, focal_px=part.guess.focal_px * factor)

    def load(i: int) -> Measurement:
        measured = part.load(i)
        if not isinstance(measured, Frame):
            return measured
        return replace(measured, images={name: _resized(image, rig, name) for name, image in measured.images.items()})

    return replace(part, rig=rig, load=load, guess=guess)


def _resized(image: Image, rig: Rig, name: str) -> Image:
    size = rig.camera(name).width, rig.camera(name).height
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
