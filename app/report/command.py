"""The command: reads the folders, writes the page."""

from __future__ import annotations

import sys
from pathlib import Path

from ispom.errors import InputError
from ispom.io.whole import write_whole

from ..options import Report
from .folder import read_run
from .page import page


def report(options: Report) -> int:
    """Writes the page; InputError where a folder holds no complete run, or the page cannot be written."""
    if options.out.suffix.lower() not in (".html", ".htm") or options.out.is_dir():
        raise InputError(f"--out is {options.out}: give a file name that ends in .html")
    folders = [folder.expanduser() for folder in options.runs]
    runs = [read_run(folder, label) for folder, label in zip(folders, _labels(folders), strict=True)]
    write_whole(options.out, page(runs))
    sys.stdout.write(f"{options.out} ({options.out.stat().st_size / 1e6:.1f} MB)\n")
    return 0


def _labels(folders: list[Path]) -> list[str]:
    """The folders' names; their paths where two have the same name."""
    names = [folder.resolve().name for folder in folders]
    return names if len(set(names)) == len(names) else [str(folder) for folder in folders]
