"""`--out`: the calibration in the format of `--format`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ispom.calibration.pair import rectifying
from ispom.calibration.result import Clock
from ispom.errors import InputError, printable
from ispom.io.calibrations.files import placed_of, rig_files
from ispom.io.calibrations.pair import pair_fault
from ispom.io.calibrations.recognised import one_rig
from ispom.io.camera import LINE_DELAY
from ispom.io.files import expanded
from ispom.io.rig import SIGMAS, rig_text
from ispom.io.whole import require_no_links
from ispom.types import Rig

from ...engine.outputs import require_own, write_file
from .options import Calibrate, Format
from .words import clock_words

SIGNATURE = "Written by `ispom calibrate`"


def require_writable(path: Path, form: Format) -> None:
    """InputError where something else is there."""
    if form in ("euroc", "ros") and path.suffix == "":
        return
    require_own(path, SIGNATURE)


def save(rig: Rig, clock: Clock | None, about: str, path: Path, form: Format) -> None:
    """Writes the file, or the files of a folder where the format has one for each camera; says on standard error what
    the format cannot hold."""
    _write(rig, clock, about, path, form)
    for lost in left_out(rig, form):
        sys.stderr.write(printable(lost) + "\n")


def left_out(rig: Rig, form: Format) -> Iterator[str]:
    """A sentence each about what only our own formats say: rolling shutters, and how sure the calibration is."""
    rolling = [each.name for each in placed_of(rig) if each.camera.line_delay_s]
    if rolling and form not in ("rig", "camera"):
        which = f"{LINE_DELAY} of {' and '.join(rolling)}"
        yield f"--format {form} has no place for a rolling shutter: {which} is left out; rig.yaml keeps it"
    unplaced = poses_lost(rig, form)
    if unplaced:
        yield f"--format {form} has no poses of {' and '.join(unplaced)}: left out; rig.yaml keeps them"
    sigmas = [name for name in SIGMAS if getattr(rig, name) is not None]
    if sigmas and form != "rig":
        what = "how sure the calibration is"
        yield f"--format {form} has no place for {what}: left out: {' and '.join(sigmas)}; rig.yaml keeps it"


def poses_lost(rig: Rig, form: Format) -> list[str]:
    """Cameras whose places in the rig a format cannot hold: COLMAP's has none, and ROS's those of a pair only."""
    cameras = [each.name for each in placed_of(rig)]
    if len(cameras) < 2 or form not in ("colmap", "ros"):
        return []
    return [name for name in cameras if form == "colmap" or not rig.has_stereo or name == "video"]


def _write(rig: Rig, clock: Clock | None, about: str, path: Path, form: Format) -> None:
    comment = f"# {SIGNATURE}: {printable(about)}"
    if clock is not None:
        comment += f"\n# {clock_words(clock)}"
    if form == "rig":
        text = f"{comment}\n# poses are rig_from_CAMERA, x_rig = R x_camera + t [m]; see docs/start/own_rig.md\n"
        write_file(path, text + rig_text(rig), SIGNATURE)
        return
    files = rig_files(rig, form)
    if len(files) == 1 and path.suffix:
        write_file(path, _commented(next(iter(files.values())), comment), SIGNATURE)
        return
    if path.suffix:
        raise InputError(f"--format {form} makes {len(files)} files: give --out the name of a folder")
    for name, text in files.items():
        require_no_links(path, path / name)
        write_file(path / name, _commented(text, comment), SIGNATURE)


def _commented(text: str, comment: str) -> str:
    """OpenCV's files begin with their directive."""
    first, _, rest = text.partition("\n")
    return f"{first}\n{comment}\n{rest}" if first.startswith("%YAML") else f"{comment}\n{text}"


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
    """Whether the cameras are side by side: the frame of others would be turned along with their baseline."""
    return not pair_fault(rig.rig_from_left.inverse() @ rig.rig_from_right)


def _with_usual_frame(rig: Rig) -> Rig:
    """The rig at the middle of the baseline (Fig. 6), not in the left camera as other programs have it."""
    left, right = rectifying(rig.rig_from_right.inverse() @ rig.rig_from_left)
    new_from_old = left @ rig.rig_from_left.inverse()
    moved = {f"rig_from_{name}": new_from_old @ sensor.rig_from_sensor for name, sensor in rig.sensors.items()}
    return rig.changed(**{**moved, "rig_from_left": left, "rig_from_right": right})
