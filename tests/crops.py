"""A rig of two cameras with little or no overlap, made from a stereo sequence; and single cameras of a rig."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ispom.errors import InputError
from ispom.types import Frame, Measurement, Rig, Sequence

OUTER = ("outer_left", "outer_right")
"""Names of the two cameras."""


def cropped_pair(sequence: Sequence, overlap: float) -> Sequence:
    """Returns the pairs of a sequence as frames of two cameras that share `overlap` (0 to 1) of each one's width at
    infinity: `outer_left` is the left part of the left image, `outer_right` the right part of the right one.

    Raises InputError for a sequence without pairs, and another overlap.
    """
    rig = sequence.rig
    if not rig.has_stereo or "stereo" not in sequence.kinds:
        raise InputError(f"{sequence.name} has no stereo frames that could be cropped")
    if not 0 <= overlap <= 1:
        raise InputError(f"the overlap is {overlap:g}, give a value from 0 to 1")
    camera = rig.camera("left")
    width = round(camera.width / (2 - overlap))
    cut = camera.width - width
    cameras = replace(camera, width=width), replace(rig.camera("right"), width=width, cx=rig.camera("right").cx - cut)
    values = dict(zip(OUTER, cameras, strict=True))
    poses = {f"rig_from_{name}": rig.rig_from(side) for name, side in zip(OUTER, ("left", "right"), strict=True)}
    index = [i for i, kind in enumerate(sequence.kinds) if kind == "stereo"]

    def load(i: int) -> Measurement:
        pair = sequence[index[i]]
        assert isinstance(pair, Frame)
        images = pair.left[:, :width], pair.right[:, cut:]
        return Frame(pair.time_ns, {n: np.ascontiguousarray(im) for n, im in zip(OUTER, images, strict=True)})

    return replace(
        sequence,
        name=f"{sequence.name}, two cameras with {overlap:.0%} overlap",
        rig=Rig.of(**values, **poses),
        times_ns=sequence.times_ns[index],
        kinds=("cameras",) * len(index),
        load=load,
        notes=(*sequence.notes, "cameras are parts of the images of a stereo pair"),
        prepare=None,
        guess=None,
    )


def only_cameras(sequence: Sequence, names: Iterable[str]) -> Sequence:
    """Returns the sequence as if its rig had these cameras alone. Raises InputError where it lacks one of them."""
    wanted = tuple(names)
    if missing := [name for name in wanted if name not in sequence.rig.cameras]:
        raise InputError(f"{sequence.name} has no camera {missing[0]}: choose of {', '.join(sequence.rig.cameras)}")
    sensors = {name: s for name, s in sequence.rig.sensors.items() if name in wanted}

    def load(i: int) -> Measurement:
        frame = sequence[i]
        return (
            Frame(frame.time_ns, {n: image for n, image in frame.images.items() if n in wanted})
            if isinstance(frame, Frame)
            else frame
        )

    return replace(sequence, name=f"{sequence.name}, {', '.join(wanted)}", rig=Rig(sensors), load=load)
