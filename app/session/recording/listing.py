"""The recordings folder: what is in it, and what a new recording may be called."""

from __future__ import annotations

import re
import stat
from pathlib import Path

from ispom.errors import InputError
from ispom.io.whole import part_of

from ...run.folder.run_file import read_run_file
from ...run.folder.run_folder import RECORDING
from ..state import RecordedFile

_PLAIN = re.compile(r"[\w][\w .()+-]{0,99}")


def recording_path(folder: Path, name: str, sequence: str) -> Path:
    """Where a recording of this name goes: never outside the folder, never over an existing file.

    An empty name is made up from the sequence's. InputError where the name is not a plain file name, or taken.
    """
    name = name.strip().removesuffix(".rrd")
    if not name:
        base = re.sub(r"[^\w]+", "-", sequence).strip("-") or "run"
        taken = (folder / f"{base}-{i}.rrd" for i in range(1, 10_000))
        return next(path for path in taken if not path.exists() and not part_of(path).exists())
    if not _PLAIN.fullmatch(name) or name.endswith("."):
        raise InputError(f"{name!r} is not a plain file name: use letters, digits, spaces and - _ . ( ) + only")
    path = folder / f"{name}.rrd"
    if path.exists():
        raise InputError(f"{path.name} exists already: give the recording another name")
    return path


def list_recordings(folder: Path) -> tuple[RecordedFile, ...]:
    """The finished recordings, newest first. What cannot be looked at, such as a link that leads nowhere, and what is
    still being written is not among them."""
    found: list[tuple[float, RecordedFile]] = []
    for path in folder.glob("**/*.rrd") if folder.is_dir() else ():
        try:
            facts = path.stat()
        except OSError:
            continue
        if stat.S_ISREG(facts.st_mode) and not path.name.startswith("."):
            name = path.relative_to(folder).as_posix()
            found.append((facts.st_mtime, RecordedFile(name, facts.st_size, _about(path))))
    return tuple(file for _, file in sorted(found, key=lambda item: -item[0]))


def _about(path: Path) -> str:
    """Of the run around a recording; empty where there is none that can be read."""
    if path.name != RECORDING:
        return ""
    try:
        run = read_run_file(path.parent)
    except InputError:
        return ""
    return f"{run.sequence}, {sum(n for n in run.exposures.values() if isinstance(n, int))} exposures"
