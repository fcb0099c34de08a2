"""Calibrations that were made in the page, kept in folders of their own: what a run needs, all numbers, the report."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from ispom.calibration.result import Calibration
from ispom.errors import InputError
from ispom.io.whole import write_whole

from .numbers import numbers_text
from .report import page
from .saved import save

RIG, NUMBERS, REPORT = "rig.yaml", "calibration.json", "report.html"
FILES = (RIG, NUMBERS, REPORT)
MOST_LISTED = 50


@dataclass(frozen=True)
class Kept:
    """One of them."""

    name: str
    """Of its folder: when it was made."""
    level: str
    """Good, usable or redo."""
    what: str
    """Which target and cameras."""
    files: tuple[str, ...]


def keep(found: Calibration, folder: Path) -> str:
    """Writes them below the folder and says the name; the rig only where it is usable. InputError where that fails."""
    name = _free(folder, time.strftime("%Y-%m-%d %H.%M.%S"))
    place = folder / name
    if found.verdict.level != "redo":
        about = f"{found.verdict.level}, reprojection error {found.solution.rms_px:.3f} px"
        save(found.rig, found.clock, about, place / RIG, "rig")
    write_whole(place / NUMBERS, numbers_text(found))
    write_whole(place / REPORT, page(found))
    return name


def kept_in(folder: Path) -> tuple[Kept, ...]:
    """The newest ones first; folders that hold something else are left out."""
    found = []
    for numbers in sorted(folder.glob(f"*/{NUMBERS}"), reverse=True)[:MOST_LISTED]:
        try:
            content = json.loads(numbers.read_text(encoding="utf-8"))
            what = f"{content['target']}, {' '.join(content['cameras'])}"
            files = tuple(name for name in FILES if (numbers.parent / name).is_file())
            found.append(Kept(numbers.parent.name, str(content["verdict"]), what, files))
        except (OSError, ValueError, KeyError, TypeError):
            continue
    return tuple(found)


def files_of(folder: Path) -> Iterable[str]:
    """The files of all, as addresses name them."""
    return (f"{each.name}/{name}" for each in kept_in(folder) for name in each.files)


def _free(folder: Path, name: str) -> str:
    for candidate in (name, *(f"{name} {n}" for n in range(2, 100))):
        if not (folder / candidate).exists():
            return candidate
    raise InputError(f"{folder} holds a hundred calibrations of this second: remove some")
