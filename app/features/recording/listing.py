"""The recordings folder: its files, those that belong to a recording, and names for a new one."""

from __future__ import annotations

import logging
import re
import stat
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from ispom.errors import InputError, is_text
from ispom.io.mapping import read_mapping
from ispom.io.whole import part_of, replace_whole, whole_of

from ...engine.events import Bookmark, Opened
from ...engine.run_folder.run_file import RunFile, read_run_file
from ...engine.run_folder.run_folder import MARKER, RECORDING, RUN, THUMBNAIL, is_locked, is_unfinished, repaired
from ...engine.run_folder.thumbnail import thumbnail
from ...session.sources.folders import run_name
from ...session.state import State
from ...views.rerun.repair import unfinished
from ..bookmarks.notes import notes_of, put, tidy
from .state import ListedRun

log = logging.getLogger(__name__)


def picture_of(recording: Path) -> Path:
    return recording.with_suffix(".jpg")


def write_companions(recording: Path, opened: Opened, count: int, bookmarks: tuple[Bookmark, ...]) -> None:
    """Of a recording of a run's first `count` frames. Where the disk does not take them, it goes without."""
    times_ns = opened.sequence.times_ns[:count]
    duration_s = round(float(times_ns[-1] - times_ns[0]) * 1e-9, 3) if len(times_ns) else 0.0
    about = {"source": opened.sequence.name, "exposures": count, "duration_s": duration_s}
    try:
        put(notes_of(recording), about=about, bookmarks=bookmarks)
        if picture := thumbnail(opened.sequence, count):
            replace_whole(picture_of(recording), picture)
    except (InputError, OSError) as fault:
        log.warning("%s has no picture or notes: %s", recording, fault)


MOST_READ = 500
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


def list_recordings(folder: Path) -> tuple[ListedRun, ...]:
    """The finished runs and recordings, newest first. What cannot be looked at, such as a link that leads nowhere, what
    no page can name, and what is still being written is not among them."""
    found: list[tuple[float, ListedRun]] = []
    if not folder.is_dir():
        return ()
    files = {path for path in folder.rglob("*") if path.suffix == ".rrd" or path.name == RUN}
    for path in sorted(files):
        run = path.parent if path.name == RUN or (path.name == RECORDING and path.parent / RUN in files) else None
        if path.name.startswith(".") or not is_text(path) or (run is not None and path.name == RECORDING):
            continue
        with suppress(OSError):
            facts = path.stat()
            if stat.S_ISREG(facts.st_mode) and (run is None or _ended(run)):
                found.append((facts.st_mtime, _recording(folder, path) if run is None else _run(folder, run)))
    return tuple(kept for _, kept in sorted(found, key=lambda item: -item[0]))


def list_unfinished(folder: Path) -> tuple[Path, ...]:
    """The recordings (their parts) and folders of runs that a stopped program left unfinished; none that is being
    written. OSError where the folder cannot be read."""
    if not folder.is_dir():
        return ()
    parts = [path for path in unfinished(folder) if path != whole_of(path) and not is_locked(whole_of(path))]
    runs = [path for path in sorted(folder.iterdir()) if is_unfinished(path) and not is_locked(path)]
    return (*parts, *runs)


def _ended(run: Path) -> bool:
    """Whether it came to its end, or has a finished recording of how far it came, or was repaired."""
    return (run / RECORDING).exists() or not (run / MARKER).exists() or bool(repaired(run))


def _run(folder: Path, path: Path) -> ListedRun:
    recording, picture = path / RECORDING, path / THUMBNAIL
    listed = ListedRun(
        _name(folder, path),
        sum(file.stat().st_size for file in path.iterdir() if file.is_file()),
        _name(folder, recording) if recording.exists() else "",
        _name(folder, picture) if picture.exists() else "",
        note=_notes(notes_of(path)).get("note", ""),
    )
    try:
        run = described(path, (path / RUN).stat().st_mtime_ns)
    except InputError:
        return listed
    exposures = sum(n for n in run.exposures.values() if isinstance(n, int))
    return replace(listed, source=run.sequence, exposures=exposures, duration_s=run.duration_s)


@lru_cache(MOST_READ)
def described(path: Path, _changed_ns: int) -> RunFile:
    """The whole file is checked, which takes a while: once for each change of it."""
    return read_run_file(path)


def _recording(folder: Path, path: Path) -> ListedRun:
    picture, found = picture_of(path), _notes(notes_of(path))
    about = found["about"] if isinstance(found.get("about"), dict) else {}
    source, exposures, duration_s = (about.get(name) for name in ("source", "exposures", "duration_s"))
    return ListedRun(
        _name(folder, path),
        path.stat().st_size,
        _name(folder, path),
        _name(folder, picture) if picture.exists() else "",
        source if isinstance(source, str) else "",
        exposures if isinstance(exposures, int) else 0,
        float(duration_s) if isinstance(duration_s, int | float) else 0.0,
        found.get("note", ""),
    )


def _name(folder: Path, path: Path) -> str:
    return path.relative_to(folder).as_posix()


def _notes(path: Path) -> dict[str, Any]:
    """What a file of notes says; nothing where it is missing or damaged."""
    try:
        found = read_mapping(path) if path.exists() else {}
    except InputError:
        return {}
    return found | {"note": tidy(str(found.get("note", "")))}


class Known:
    """`recordings` is their folder."""

    def __init__(self, recordings: Path) -> None:
        self._recordings = recordings

    def source(self, name: str, state: State) -> str:
        """The source of a name, as the list of recordings has it or `run_name` gives it.

        InputError if nothing is known by it.
        """
        runs = [str(path.parent) for path in sorted(self._recordings.glob(f"*/{RUN}"))]
        listed = [kept.name for kept in list_recordings(self._recordings)]  # another process may have finished a run
        recorded = [str(self._recordings / kept) for kept in listed]
        if name in listed:
            return str(self._recordings / name)
        for source in (state.source, *state.recent, *runs, *recorded):
            if run_name(source) == name:
                return source
        raise InputError(f"there is no run called {name[:60]!r} here: open its source, or correct the address")
