"""The streams of a user's own rig, and the times of their images, also from the names of images."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.sequences.formats.folder import folder_stream
from ispom.sequences.formats.video import video_stream
from ispom.sequences.named import Named, ticks_of_pair
from ispom.sequences.stream import Clock, Stream
from ispom.types import Image

Half = Literal["left", "right", "top", "bottom"]
HALVES: tuple[Half, ...] = get_args(Half)
"""Halves of images that contain those of two cameras, side by side or one above the other."""


@dataclass(frozen=True, eq=False)
class StreamInput:
    """The images of one camera, without times."""

    source: Path
    size: tuple[int, int]
    """(width, height) of the camera's images."""
    clock: Clock
    images: Named | None = None
    """The images of a folder; None for a video file."""
    half: Half | None = None
    """The half of the images that is the camera's; None for whole images."""

    @property
    def whole_size(self) -> tuple[int, int]:
        """(width, height) of the stored images."""
        wide, high = self.half in ("left", "right"), self.half in ("top", "bottom")
        return self.size[0] * (1 + wide), self.size[1] * (1 + high)

    @property
    def stamps_ns(self) -> NDArray[np.int64] | None:
        """(N,) times from the names of the images; None where these are no times, or the clock has times or a rate."""
        has_times = self.clock.times is not None or self.clock.rate_hz is not None
        return None if has_times or self.images is None else self.images.stamps_ns


def streams(path: Path, inputs: dict[str, StreamInput]) -> dict[str, Stream]:
    """By camera, as `path` has them. Raises InputError where images cannot be put in time, or the pair's not in
    pairs."""
    stamps = [one.stamps_ns for one in inputs.values()]
    first = [int(stamps_ns[0]) for stamps_ns in stamps if stamps_ns is not None]
    # Where another camera's times are counted from its first image, so are those of the names.
    absolute = all(s is not None or one.clock.times is not None for s, one in zip(stamps, inputs.values(), strict=True))
    since_ns = 0 if absolute or not first else min(first)
    ticks = _ticks(path, inputs["left"], inputs["right"]) if "left" in inputs else {}
    result, films = {}, {}
    for name, one in inputs.items():
        if one.images is None:
            film = (one.source, one.whole_size, one.clock)
            whole = films[film] if film in films else films.setdefault(film, video_stream(*film))
        else:
            whole = folder_stream(one.source, one.whole_size, one.clock, one.images, ticks.get(name), since_ns)
        result[name] = whole if one.half is None else _half_of(whole, one.half)
    return result


def _half_of(stream: Stream, half: Half) -> Stream:
    def read(i: int) -> Image:
        image = stream.read(i)
        rows, columns = image.shape[0] // 2, image.shape[1] // 2
        parts = {"left": image[:, :columns], "right": image[:, columns:], "top": image[:rows], "bottom": image[rows:]}
        part = np.ascontiguousarray(parts[half])
        part.setflags(write=False)
        return part

    return replace(stream, read=read)


def _ticks(path: Path, left: StreamInput, right: StreamInput) -> dict[str, NDArray[np.int64]]:
    """Returns the numbers of a pair's images at their rate, if only names or order show which were taken together."""
    if left.images is None or right.images is None:
        return {}
    ticks = ticks_of_pair(left.images, right.images)
    if ticks is not None:
        return {"left": ticks[0], "right": ticks[1]}
    clocks = [one.clock.times is not None or one.clock.rate_hz is not None for one in (left, right)]
    if not any(clocks) and (left.stamps_ns is None) != (right.stamps_ns is None):
        raise InputError(
            f"{path}: the names of the images of only one of left and right are times: give the times of both, or name "
            "both in one way"
        )
    counts = [len(left.images.names), len(right.images.names)]
    by_order = [one.clock.times is None and one.stamps_ns is None for one in (left, right)]
    if all(by_order) and counts[0] != counts[1]:
        raise InputError(
            f"{path}: there are {counts[0]} left and {counts[1]} right images, and their names do not show which were "
            "taken together: give the times of both, or names with common numbers"
        )
    return {"left": np.arange(counts[0]), "right": np.arange(counts[1])} if all(by_order) else {}
