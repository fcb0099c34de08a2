"""`ispom calibrate target`: a page to print."""

from __future__ import annotations

import sys
from pathlib import Path

from ispom.calibration.targets.drawing import page_size_m, pdf, svg
from ispom.calibration.targets.layouts import parse_target
from ispom.errors import InputError, printable
from ispom.io.files import expanded

from ...engine.outputs import write_file
from .options import Calibrate

_KINDS = {".svg": ("<svg", svg), ".pdf": ("%PDF", pdf)}
LARGEST_M = 5.0
DEFAULT = Path("target.pdf")


def print_target(options: Calibrate) -> int:
    """Writes the page, and says how large it is. Raises InputError where not one target is given, or it fits no
    page."""
    if len(options.images) != 1 or options.target is not None or options.from_motion:
        raise InputError("one target is printed: give its specification alone, such as chessboard:9x6:0.0242")
    spec = str(options.images[0])
    target, path = parse_target(spec), expanded(options.out or DEFAULT)
    if path.suffix.lower() not in _KINDS:
        raise InputError(f"--out is {path}: give a file name that ends in .pdf or .svg")
    width, height = page_size_m(target)
    if max(width, height) > LARGEST_M:
        raise InputError(f"{spec} is {width:.1f} x {height:.1f} m, sizes are in metres: correct them")
    head, drawn = _KINDS[path.suffix.lower()]
    write_file(path, drawn(target), head)
    size = f"{1000 * width:.0f} x {1000 * height:.0f} mm"
    sys.stdout.write(printable(f"{path}: {size}; print at 100 %, then measure the pattern") + "\n")
    return 0
