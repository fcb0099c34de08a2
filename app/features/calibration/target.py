"""`ispom target`: a page to print."""

from __future__ import annotations

import sys

from ispom.calibration.targets.drawing import page_size_m, pdf, svg
from ispom.calibration.targets.layouts import parse_target
from ispom.errors import InputError, printable
from ispom.io.files import expanded

from ...engine.outputs import write_file
from .options import PrintTarget

_KINDS = {".svg": ("<svg", svg), ".pdf": ("%PDF", pdf)}
LARGEST_M = 5.0


def print_target(options: PrintTarget) -> int:
    """Writes the page, and says how large it is."""
    target, path = parse_target(options.target), expanded(options.out)
    if path.suffix.lower() not in _KINDS:
        raise InputError(f"--out is {path}: give a file name that ends in .pdf or .svg")
    width, height = page_size_m(target)
    if max(width, height) > LARGEST_M:
        raise InputError(f"{options.target} is {width:.1f} x {height:.1f} m, sizes are in metres: correct them")
    head, drawn = _KINDS[path.suffix.lower()]
    write_file(path, drawn(target), head)
    size = f"{1000 * width:.0f} x {1000 * height:.0f} mm"
    sys.stdout.write(printable(f"{path}: {size}; print at 100 %, then measure the pattern") + "\n")
    return 0
