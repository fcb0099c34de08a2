"""A person's notes as a file, a note and bookmarks: notes.yaml in a run's folder, NAME.notes.yaml next to a recording,
or one for each source next to all recordings."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict
from hashlib import blake2b
from pathlib import Path
from typing import Any

import yaml

from ispom.errors import InputError
from ispom.io.files import exists
from ispom.io.mapping import read_mapping
from ispom.io.whole import replace_whole
from ispom.types import Sequence

from ...engine.events import Bookmark
from ...engine.run_folder.run_folder import NOTES

MOST, NOTE_LENGTH = 500, 200
"""Bookmarks of a run, and characters of a note."""


def notes_path(stored: Path | None, recordings: Path, source: str) -> Path:
    """Where the bookmarks are: in the folder of a stored run, next to a recording, or of a `source` next to all
    recordings."""
    if stored is not None:
        return notes_of(stored)
    plain = re.sub(r"[^\w]+", "-", source).strip("-")[-40:]
    return recordings / "notes" / f"{plain}-{blake2b(source.encode(), digest_size=4).hexdigest()}.yaml"


def notes_of(stored: Path) -> Path:
    """Where the notes on a run's folder, or on a recording, are."""
    return stored / NOTES if stored.suffix != ".rrd" else stored.with_suffix(f".{NOTES}")


def put(
    path: Path,
    *,
    note: str | None = None,
    about: Mapping[str, Any] | None = None,
    bookmarks: tuple[Bookmark, ...] | None = None,
) -> None:
    """Changes these parts of a file, None leaving them; with nothing in it there is no file. `about` is what a
    recording is of: source, frames, duration_s.

    InputError where the file is not as written, or the disk does not take it.
    """
    entries = None if bookmarks is None else [asdict(bookmark) for bookmark in bookmarks]
    new = {"note": None if note is None else tidy(note), "about": about, "bookmarks": entries}
    with _alone(path.parent):
        written = _written(path)
        _write(path, written | {name: value for name, value in new.items() if value is not None})


def change_bookmark(path: Path, sequence: Sequence, exposure: int, mark: Bookmark | None) -> tuple[Bookmark, ...]:
    """Puts one bookmark of a file, or with None removes that of the frame, and returns all that fit the frames
    then. What others put there meanwhile stays, and so does what fits the source only when it is opened otherwise.

    InputError where the file is not as written, is full, or the disk does not take it.
    """
    with _alone(path.parent):
        written = _written(path)
        entries = [_bookmark(path, entry) for entry in _entries(path, written)]
        others = [b for b in entries if (here := _placed(b, sequence)) is None or here.exposure != exposure]
        if mark is not None:
            if len(others) >= MOST:
                raise InputError(f"{path} has {MOST} bookmarks: remove one first")
            others.append(mark)
        _write(path, written | {"bookmarks": [asdict(b) for b in sorted(others, key=lambda b: b.time_ns)]})
    return _fitting(others, sequence)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Keeps other apps from changing notes in this folder meanwhile. Goes on without where the system cannot."""
    with ExitStack() as stack:
        if sys.platform != "win32":
            import fcntl

            with suppress(OSError):
                folder.mkdir(parents=True, exist_ok=True)
                place = os.open(folder, os.O_RDONLY)
                stack.callback(os.close, place)
                fcntl.flock(place, fcntl.LOCK_EX)
        yield


def _write(path: Path, content: Mapping[Any, Any]) -> None:
    try:
        if any(content.values()):
            replace_whole(path, yaml.safe_dump(dict(content), sort_keys=False, allow_unicode=True))
        else:
            path.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror}): free some space, and note it again") from None


def read_notes(path: Path, sequence: Sequence) -> tuple[Bookmark, ...]:
    """Those of a file that fit the frames: at their number or, where the source was opened otherwise, at their time.

    InputError where the file is not as written.
    """
    return _fitting([_bookmark(path, entry) for entry in _entries(path, _written(path))], sequence)


def _entries(path: Path, content: Mapping[Any, Any]) -> list[object]:
    entries = content.get("bookmarks", [])
    if not isinstance(entries, list) or len(entries) > MOST:
        raise InputError(f"{path} has no bookmarks as the app writes them: correct or remove it")
    return entries


def _fitting(bookmarks: Iterable[Bookmark], sequence: Sequence) -> tuple[Bookmark, ...]:
    found = (_placed(bookmark, sequence) for bookmark in bookmarks)
    by_exposure = {bookmark.exposure: bookmark for bookmark in found if bookmark is not None}
    return tuple(by_exposure[i] for i in sorted(by_exposure))


def _written(path: Path) -> dict[Any, Any]:
    """What the file says, nothing where there is none. InputError where it is a link: it may show any file of the
    user."""
    if path.is_symlink():
        raise InputError(f"{path} is a link: put the file itself there, or remove it")
    return read_mapping(path) if exists(path) else {}


def _bookmark(path: Path, entry: object) -> Bookmark:
    values = entry if isinstance(entry, dict) else {}
    exposure, time_ns, note = (values.get(name) for name in ("exposure", "time_ns", "note"))
    if not isinstance(exposure, int) or not isinstance(time_ns, int) or not isinstance(note, str):
        raise InputError(f"{path} says of a bookmark {str(entry)[:60]!r}: correct or remove it")
    return Bookmark(exposure, time_ns, tidy(note))


def _placed(bookmark: Bookmark, sequence: Sequence) -> Bookmark | None:
    times_ns, i = sequence.times_ns, bookmark.exposure
    if 0 <= i < len(times_ns) and times_ns[i] == bookmark.time_ns:
        return bookmark
    same = (times_ns == bookmark.time_ns).nonzero()[0]
    return Bookmark(int(same[0]), bookmark.time_ns, bookmark.note) if len(same) else None


def tidy(note: str) -> str:
    """On one line, not too long."""
    return " ".join(note.split())[:NOTE_LENGTH]
