"""The command: reads the folders, writes the page."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from ispom.errors import InputError, printable

from ...engine.outputs import require_own, write_file
from ...engine.run_folder.run_folder import MARKER
from .folder import read_run
from .options import Report
from .page import GENERATOR, page

RECORDINGS = Path("recordings")
"""Where runs are written to unless something else is asked."""


def report(options: Report) -> int:
    """Writes the page; InputError where a folder holds no complete run, or the page cannot be written."""
    if not options.runs:
        raise InputError(f"no run was given: name one or more folders that `ispom run` wrote{_example()}")
    if options.out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--out is {options.out}: give a file name that ends in .html")
    require_own(options.out, GENERATOR)
    folders = [folder.expanduser() for folder in options.runs]
    runs = [read_run(folder, label) for folder, label in zip(folders, _labels(folders), strict=True)]
    write_file(options.out, page(runs), GENERATOR)
    sys.stdout.write(f"{printable(str(options.out))} ({options.out.stat().st_size / 1e6:.1f} MB)\n")
    return 0


def _example() -> str:
    """The newest run in the default place, if there is one."""
    found = [path.parent for path in RECORDINGS.glob("*/run.yaml") if not (path.parent / MARKER).exists()]
    newest = max(found, key=lambda folder: (folder / "run.yaml").stat().st_mtime, default=None)
    return f", such as {newest}" if newest else f" (by default below {RECORDINGS})"


def _labels(folders: list[Path]) -> list[str]:
    """The folders' names; their paths where two have the same name."""
    names = [os.path.basename(os.path.realpath(folder)) for folder in folders]
    return names if len(set(names)) == len(names) else [str(folder) for folder in folders]
