"""Combines two streams into pairs of rectified images."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.io.calibrations.pair import pair_fault
from ispom.sequences.matching import pairs, unmatched_note
from ispom.sequences.recording import Side
from ispom.sequences.rectification import Rectification, remapped
from ispom.sequences.stream import Stream, size_of
from ispom.types import Image, Rig


@dataclass(frozen=True, eq=False)
class StereoStream:
    """Left and right images exposed together."""

    rig: Rig
    """The rig with rectified cameras in place of the raw ones."""
    times_ns: NDArray[np.int64]
    """(N,) increasing, those of the left images."""
    read: Callable[[Side, int], Image]
    """Rectified image i of a side; InputError where it is unreadable or of the wrong size."""
    notes: tuple[str, ...]


def stereo_stream(path: Path, rig: Rig, left: Stream, right: Stream) -> StereoStream:
    """Returns the pairs of two streams of a rig with both cameras, as given in `path`.

    Raises InputError where no images are of the same time, and where the rig is not that of a stereo camera.
    """
    i_left, i_right = pairs(left.times_ns, right.times_ns)
    if not len(i_left):
        raise InputError(f"{path}: no left and right image are of the same time: correct their times or offset_s")
    rectified, streams = _rectification(path, rig), {"left": (left, i_left), "right": (right, i_right)}
    notes = left.notes + right.notes + unmatched_note(len(left.times_ns), len(right.times_ns), len(i_left))

    def raw(side: Side, i: int) -> Image:
        stream, index = streams[side]
        return stream.read(int(index[i]))

    def straight(side: Side, i: int) -> Image:
        return remapped(raw(side, i), maps[side])

    if rectified is None:
        return StereoStream(rig, left.times_ns[i_left], raw, notes)
    maps = {"left": rectified.left_maps, "right": rectified.right_maps}
    return StereoStream(rectified.placed(rig), left.times_ns[i_left], straight, notes)


def level_pair(
    path: Path, streams: Mapping[Side, Stream]
) -> tuple[NDArray[np.int64], Callable[[Side, int], Image], tuple[str, ...]]:
    """Returns times (N,), a function that reads image i of a side, and notes, for a left and, optionally, a right
    stream of rectified images. Raises InputError where no images are of the same time."""
    left, right = streams["left"], streams.get("right")
    if right is None:
        return left.times_ns, lambda _, i: left.read(i), left.notes
    i_left, i_right = pairs(left.times_ns, right.times_ns)
    if not len(i_left):
        raise InputError(f"{path}: no left and right image are of the same time: restore the missing ones")
    index = {"left": i_left, "right": i_right}

    def read(side: Side, i: int) -> Image:
        return streams[side].read(int(index[side][i]))

    notes = left.notes + right.notes + unmatched_note(len(left.times_ns), len(right.times_ns), len(i_left))
    return left.times_ns[i_left], read, tuple(dict.fromkeys(notes))


def _rectification(path: Path, rig: Rig) -> Rectification | None:
    """Returns the rectification of the images; None where they are already rectified."""
    left, right = rig.camera("left"), rig.camera("right")
    right_from_left = rig.rig_from_right.inverse() @ rig.rig_from_left
    fault = pair_fault(right_from_left.inverse())
    why = f" ({fault})" if fault else ""
    misplaced = InputError(
        f"{path}: its rig does not put the right camera to the right of the left one{why}: correct the rig"
    )
    if fault:
        raise misplaced
    parallel = abs(right_from_left.rotation - np.eye(3)).max() < 1e-7
    level = abs(right_from_left.translation[1:]).max() <= 1e-6 * abs(right_from_left.translation[0])
    if left == right and not left.distortion and parallel and level:
        if rig.baseline_m <= 0:
            raise misplaced
        return None
    if size_of(left) != size_of(right):
        raise InputError(f"{path}: left and right images are not of one size: give a rig of two equal cameras")
    if left.lens != right.lens:
        raise InputError(
            f"{path}: one lens of the pair is a fisheye and the other is not: give a rig of two equal cameras"
        )
    try:
        rectification = Rectification.of(left, right, right_from_left)
    except ValueError:
        raise misplaced from None
    if rectification.baseline_m <= 0:
        raise misplaced
    return rectification
