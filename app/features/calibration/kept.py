"""Calibrations that were made in the page, kept in folders of their own: what a run needs, all numbers, the report."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from ispom.calibration.filmed.images import CAMERAS
from ispom.calibration.result import Calibration
from ispom.errors import InputError, is_text
from ispom.io.rows import read_text
from ispom.io.whole import require_no_links, write_whole

from .numbers import numbers_text
from .report import page
from .saved import save

RIG, NUMBERS, REPORT = "rig.yaml", "calibration.json", "report.html"
FILES = (RIG, NUMBERS, REPORT)
MOST_LISTED = 50
MOST_READ = 500
"""Folders that are looked into."""
MOST_BYTES, LONGEST_TEXT = 16 << 20, 300
"""Most bytes of a file of numbers, and most characters of it that are shown."""


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
    require_no_links(folder.parent, folder / "any")
    name = _free(folder, time.strftime("%Y-%m-%d %H.%M.%S"))
    place = folder / name
    if found.verdict.level != "redo":
        about = f"{found.verdict.level}, reprojection error {found.solution.rms_px:.3f} px"
        save(found.rig, found.clock, about, place / RIG, "rig")
    write_whole(place / NUMBERS, numbers_text(found))
    write_whole(place / REPORT, page(found))
    return name


def kept_in(folder: Path) -> tuple[Kept, ...]:
    """The newest ones first; folders that hold something else are left out, and all where the folder is a link."""
    places = [] if folder.is_symlink() else sorted(folder.glob(f"*/{NUMBERS}"), reverse=True)
    found = (_kept(place.parent) for place in places[:MOST_READ])
    return tuple(islice(filter(None, found), MOST_LISTED))


def _kept(place: Path) -> Kept | None:
    """None for what is not as `keep` writes it: of these folders somebody else may have put some there."""
    try:
        content = json.loads(read_text(place / NUMBERS, MOST_BYTES))
        target, cameras, level = (content[name] for name in ("target", "cameras", "verdict"))
        files = tuple(name for name in FILES if (place / name).is_file())
    except (InputError, OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    words = isinstance(cameras, dict) and all(isinstance(word, str) for word in (target, level, *cameras))
    if not words or len(cameras) > len(CAMERAS["rig"]) or not is_text(place):
        return None
    what = f"{target}, {' '.join(cameras)}"
    return Kept(place.name, level, what, files) if len(level) + len(what) < LONGEST_TEXT else None


def files_of(folder: Path) -> Iterable[str]:
    """The files of all, as addresses name them."""
    return (f"{each.name}/{name}" for each in kept_in(folder) for name in each.files)


def _free(folder: Path, name: str) -> str:
    for candidate in (name, *(f"{name} {n}" for n in range(2, 100))):
        if not (folder / candidate).exists():
            return candidate
    raise InputError(f"{folder} holds a hundred calibrations of this second: remove some")
