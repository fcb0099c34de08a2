"""What triage.json holds."""

from __future__ import annotations

from pathlib import Path

import msgspec

from ispom.errors import InputError
from ispom.io.files import MAX_BYTES, exists, read_bytes

from .advice import Lesson
from .row import ClipRow

ALL = "triage.json"


class TriageFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What triage.json holds."""

    groups: dict[str, int]
    """Number of clips in each."""
    clips: list[ClipRow]
    how_to_film: list[Lesson]
    """What to do differently, that of most clips first."""


def read_triage(folder: Path) -> TriageFile:
    """Reads it from the folder of a triage. Raises InputError where it is not there, or not as written."""
    path = folder / ALL
    if not exists(path):
        raise InputError(f"{folder} holds no finished triage: run `ispom triage` with this folder as --out")
    try:
        return msgspec.json.decode(read_bytes(path, MAX_BYTES), type=TriageFile)
    except (ValueError, RecursionError, msgspec.MsgspecError):
        raise InputError(f"{path} is not as `ispom triage` writes it: run the same command again") from None
