"""Finds the clips of a folder: recordings, runs, and what looks like one and is none."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePath

from ispom.errors import InputError, printable
from ispom.io.files import exists, is_below, is_folder, names
from ispom.sequences import ARCHIVES, FILES, SETTINGS, layout_of, looks_like_scenario, recognised
from ispom.sequences.formats.folder import unread_images
from ispom.sequences.formats.video_folder import looks_like_video_folder
from ispom.sequences.images import IMAGE_SUFFIXES

from ...engine.outputs import MARKER, is_signed
from ...engine.run_folder.run_folder import RUN

COMMAND = "triage"

LINKED = "this is a link out of the folder, which is not followed: copy what it leads to, or give that folder"
MEDIA = (FILES | ARCHIVES) - SETTINGS
"""Suffixes of files that are a clip, or were meant to be."""
SHOWN_LETTERS = 60
"""Letters of a clip's name that are used in the names of its files; a hash of the whole name follows."""


@dataclass(frozen=True)
class Clip:
    """One recording or run in the folder."""

    source: str
    """Its path."""
    name: str
    """The same within the folder, with slashes."""
    is_run: bool = False
    """Whether it is a folder that `ispom run` wrote, which is not run again."""
    problem: str = ""
    """Why it is not even tried; empty where it is."""
    seed: int = 0

    @property
    def key(self) -> str:
        """What its files are called: plain, and different for each name."""
        digest = hashlib.sha256(self.name.encode("utf-8", "surrogateescape")).hexdigest()[:8]
        plain = re.sub(r"[^\w.-]+", "-", self.name, flags=re.ASCII).strip("-.")[:SHOWN_LETTERS]
        return f"{plain}-{digest}" if plain else digest

    @property
    def folder(self) -> PurePath:
        """Of its run, within the folder of the triage."""
        return PurePath("runs") / self.key

    def __str__(self) -> str:
        return printable(self.name)


def clips_in(folder: Path, leave_out: Path) -> list[Clip]:
    """Returns the clips at any depth, by name.

    Hidden entries, `leave_out` and folders of earlier triages are not looked at, and links are not followed: one that
    leads out of the folder is a clip with that problem. A folder in which nothing is found is a clip, too, as opening
    it says why; but not one beside clips without any image, such as one of ground truth. Raises InputError where the
    folder itself cannot be read.
    """
    found = _Search(folder, leave_out.absolute()).within(folder)
    return sorted((each.clip for each in found), key=lambda clip: clip.name)


@dataclass(frozen=True)
class _Found:
    clip: Clip
    sure: bool
    """Whether it was recognised."""
    listed: bool
    """Whether it is listed beside clips."""


@dataclass(frozen=True)
class _Search:
    root: Path
    leave_out: Path

    def within(self, place: Path) -> list[_Found]:
        """The clips of a folder, or the folder as one."""
        if exists(place / RUN):
            return [_sure(self._clip(place, is_run=True))]
        known = recognised(place)
        one_film = known and layout_of(place) is looks_like_video_folder
        if known and not one_film:
            return [_sure(self._clip(place))]
        inner = [each for name in sorted(names(place)) for each in self._entry(place / name)]
        sure = sum(each.sure for each in inner)
        if one_film and sure <= 1:
            return [_sure(self._clip(place))]
        if sure:
            inner = [each for each in inner if each.listed]
        return inner or [_Found(self._clip(place), False, _looks_like_a_failed_recording(place))]

    def _entry(self, path: Path) -> Iterator[_Found]:
        suffix = path.suffix.lower()
        if path.name.startswith(".") or path.absolute() == self.leave_out:
            return
        if path.is_symlink():
            if not is_below(path, (self.root,)) and (path.is_dir() or suffix in MEDIA):
                yield _Found(self._clip(path, problem=LINKED), False, True)
            return
        try:
            if is_folder(path):
                if not is_signed(path / MARKER, COMMAND):
                    yield from self.within(path)
            elif looks_like_scenario(path) if suffix in SETTINGS else recognised(path) or suffix in MEDIA:
                yield _sure(self._clip(path))
        except InputError as error:
            if suffix not in SETTINGS:  # a calibration that is wrong is said where it is used
                yield _Found(self._clip(path, problem=str(error)), False, True)

    def _clip(self, path: Path, is_run: bool = False, problem: str = "") -> Clip:
        name = path.relative_to(self.root).as_posix()
        return Clip(str(path), path.resolve().name if name == "." else name, is_run, problem)


def _sure(clip: Clip) -> _Found:
    return _Found(clip, True, True)


def _looks_like_a_failed_recording(place: Path) -> bool:
    """Whether a folder in which no clip was found looks like a recording that failed: it is empty, or has images."""
    inside = names(place)
    return not inside or bool(unread_images(place)) or any(Path(n).suffix.lower() in IMAGE_SUFFIXES for n in inside)


def stamp(clip: Clip) -> str:
    """Returns what changes where the files of a clip do, or those directly in its folder; empty where it is gone."""
    path = Path(clip.source)
    try:
        entries = sorted(path.iterdir()) if path.is_dir() else [path]
        files = [(entry.name, status.st_size, status.st_mtime_ns) for entry in entries for status in [entry.lstat()]]
    except OSError:
        return ""
    return hashlib.sha256(repr(files).encode("utf-8", "backslashreplace")).hexdigest()[:16]
