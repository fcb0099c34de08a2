"""`ispom calibrate convert`: a calibration from one program's format to another's."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from ispom.calibration.pair import rectifying
from ispom.errors import InputError, printable
from ispom.io.calibrations.pair import pair_fault
from ispom.io.calibrations.recognised import one_rig
from ispom.io.files import expanded
from ispom.types import Rig

from .options import Calibrate
from .saved import require_writable, save


def convert(options: Calibrate) -> int:
    """Reads, writes, and says what was found; InputError for a file of no known format."""
    if not options.images:
        raise InputError("no calibration was given: name the file to convert")
    if options.out is None:
        raise InputError("--out is missing: name the file to write, and its --format")
    require_writable(options.out, options.format)
    rig, notes = one_rig(tuple(expanded(path) for path in options.images))
    sys.stderr.write("".join(f"note: {printable(note)}\n" for note in notes))
    if rig.has_stereo and _is_left(rig) and _is_level(rig):
        rig = _with_usual_frame(rig)
    save(rig, None, f"converted from {options.images[0]}", options.out, options.format)
    present = [name for name in ("left", "right", "video") if getattr(rig, name) is not None]
    sys.stdout.write(printable(f"written: {options.out}, with {', '.join(present)}") + "\n")
    return 0


def _is_left(rig: Rig) -> bool:
    """Whether the rig's frame is that of its left camera."""
    return np.array_equal(rig.rig_from_left.matrix, np.eye(4))


def _is_level(rig: Rig) -> bool:
    """Whether the cameras stand beside each other: the frame of others would be turned along with their baseline."""
    return not pair_fault(rig.rig_from_left.inverse() @ rig.rig_from_right)


def _with_usual_frame(rig: Rig) -> Rig:
    """The rig at the middle of the baseline (Fig. 6), not in the left camera as other programs have it."""
    left, right = rectifying(rig.rig_from_right.inverse() @ rig.rig_from_left)
    new_from_old = left @ rig.rig_from_left.inverse()
    laser = None if rig.rig_from_laser is None else new_from_old @ rig.rig_from_laser
    video = new_from_old @ rig.rig_from_video
    return replace(rig, rig_from_left=left, rig_from_right=right, rig_from_video=video, rig_from_laser=laser)
