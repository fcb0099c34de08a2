"""`--out`: the calibration in the format that is asked."""

from __future__ import annotations

from pathlib import Path

from ispom.calibration.result import Clock
from ispom.errors import InputError
from ispom.io.calibrations.files import rig_files
from ispom.io.rig import rig_text
from ispom.types import Rig

from ..outputs import require_own, write_file
from .options import Format
from .words import clock_words

SIGNATURE = "Written by `ispom calibrate`"


def require_writable(path: Path, form: Format) -> None:
    """InputError where something else is there."""
    if form in ("euroc", "ros") and path.suffix == "":
        return
    require_own(path, SIGNATURE)


def save(rig: Rig, clock: Clock | None, about: str, path: Path, form: Format) -> None:
    """Writes the file, or the files of a folder where the format has one for each camera."""
    comment = f"# {SIGNATURE}: {about}"
    if clock is not None:
        comment += f"\n# {clock_words(clock)}"
    if form == "rig":
        text = f"{comment}\n# poses are rig_from_CAMERA, x_rig = R x_camera + t [m]; see the README\n"
        write_file(path, text + rig_text(rig), SIGNATURE)
        return
    files = rig_files(rig, form)
    if len(files) == 1 and path.suffix:
        write_file(path, _commented(next(iter(files.values())), comment), SIGNATURE)
        return
    if path.suffix:
        raise InputError(f"--format {form} makes {len(files)} files: give --out the name of a folder")
    for name, text in files.items():
        write_file(path / name, _commented(text, comment), SIGNATURE)


def _commented(text: str, comment: str) -> str:
    """OpenCV's files begin with their directive."""
    first, _, rest = text.partition("\n")
    return f"{first}\n{comment}\n{rest}" if first.startswith("%YAML") else f"{comment}\n{text}"
