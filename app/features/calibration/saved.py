"""`--out`: the calibration in the format of `--format`."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from ispom.calibration.pair import with_usual_frame
from ispom.calibration.result import Clock
from ispom.errors import InputError, printable
from ispom.io.calibrations.files import AnyFormat, left_out, rig_files
from ispom.io.calibrations.recognised import one_rig
from ispom.io.files import expanded
from ispom.io.rig import rig_text
from ispom.io.whole import require_no_links
from ispom.types import Rig

from ...engine.outputs import require_own, write_file
from .options import Calibrate
from .words import clock_words

SIGNATURE = "Written by `ispom calibrate`"


def require_writable(path: Path, form: AnyFormat) -> None:
    """InputError where something else is there."""
    if form in ("euroc", "ros") and path.suffix == "":
        return
    require_own(path, SIGNATURE)


def save(rig: Rig, clock: Clock | None, about: str, path: Path, form: AnyFormat) -> None:
    """Writes the file, or the files of a folder where the format has one for each camera; says on standard error what
    the format cannot hold."""
    _write(rig, clock, about, path, form)
    for lost in left_out(rig, form):
        sys.stderr.write(printable(lost) + "\n")


def _write(rig: Rig, clock: Clock | None, about: str, path: Path, form: AnyFormat) -> None:
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
    sides = None if options.image_size is None else _sides(options.image_size)
    paths = tuple(expanded(path) for path in options.images)
    rig, notes = one_rig(paths, size=None if sides is None else lambda: sides)
    sys.stderr.write("".join(f"note: {printable(note)}\n" for note in notes))
    save(with_usual_frame(rig), None, f"converted from {options.images[0]}", options.out, options.format)
    present = [name for name in ("left", "right", "video") if getattr(rig, name) is not None]
    sys.stdout.write(printable(f"written: {options.out}, with {', '.join(present)}") + "\n")
    return 0


def _sides(words: str) -> tuple[int, int]:
    """Width and height of `640x480`. InputError for other words."""
    found = re.fullmatch(r"([1-9]\d{0,4})[x×]([1-9]\d{0,4})", words.strip().lower())
    if found is None:
        raise InputError(f"--image-size is {words[:40]}, give width and height in pixels, such as 640x480")
    return int(found[1]), int(found[2])
