"""What is known of one clip: a file in JSON, written as soon as the clip is done."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path

import msgspec

from ispom.errors import InputError
from ispom.io.files import exists
from ispom.io.rows import read_text
from ispom.io.whole import require_no_links, write_whole

from ...engine.outputs import json_of
from .clips import Clip, stamp

ROWS = "rows"


class Group(StrEnum):
    """From bad to good, as the page has them."""

    UNOPENED = "cannot be opened"
    NO_MAP = "no map"
    LOST = "lost"
    SUSPICIOUS = "suspicious"
    FINE = "fine"


class Action(StrEnum):
    """What a person does about a clip."""

    NOTHING = ""
    FILM = "film again"
    SETTING = "change a setting"
    CORRECT = "correct the recording"
    LOOK = "look at it"


class ClipRow(msgspec.Struct, forbid_unknown_fields=True):
    """Of one clip, as the tables have it."""

    clip: str
    """Its name within the folder."""
    group: Group
    cause: str = ""
    """One line."""
    suspect: str = ""
    """Key and name of the doctor's suspect that explains it; empty where none does."""
    suspect_name: str = ""
    action: Action = Action.NOTHING
    advice: str = ""
    """How, as the doctor says it."""
    setting: str = ""
    """The option that makes it better, where one was found."""
    gain: str = ""
    """By how much."""
    frame: int | None = None
    """The best one to look at."""
    where: str = ""
    """The frames at which it went wrong."""
    frames: int = 0
    """Images, or pairs."""
    located_percent: dict[str, float | None] = {}
    """By method."""
    run: str = ""
    """Folder of the run, within that of the triage, or the clip itself where it is a run; empty without one."""
    complete: bool = False
    """Whether the run came to its end."""


class Row(ClipRow, forbid_unknown_fields=True):
    """Of one clip, with what only its own file has."""

    image: str = ""
    """A small JPEG of that frame, in Base64."""
    stamp: str = ""
    """See `clips.stamp`."""


def write_row(out: Path, clip: Clip, row: Row) -> None:
    """Writes the file of a clip; InputError where the disk does not take it."""
    file = _file(out, clip)
    file.parent.mkdir(exist_ok=True)
    require_no_links(out, file)
    write_whole(file, json_of(row))


def read_row(out: Path, clip: Clip) -> Row | None:
    """Returns what an earlier command found; None where it found nothing, or the clip has changed since.

    Raises InputError for a damaged file.
    """
    file = _file(out, clip)
    require_no_links(out, file)
    if not exists(file):
        return None
    try:
        row = msgspec.convert(json.loads(read_text(file)), Row)
    except (ValueError, msgspec.ValidationError):
        raise InputError(f"{file} is damaged: remove it, and give the same command again") from None
    return row if row.stamp == stamp(clip) and row.clip == str(clip) else None


def _file(out: Path, clip: Clip) -> Path:
    return out / ROWS / f"{clip.key}.json"
