"""What a person has picked, as a text that an address can carry: `track:monocular:181`, `key_frame:stereo:40`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from ispom.errors import InputError

Kind = Literal["track", "key_frame"]
_WRITTEN = re.compile(r"(track|key_frame):(?:([A-Za-z_][\w.-]*):)?(\d{1,18})")


@dataclass(frozen=True)
class Selection:
    kind: Kind
    method: str
    """Whose; empty for the first method that has it."""
    number: int
    """The id of a track, or the frame of a keyframe."""

    def __str__(self) -> str:
        return ":".join([self.kind, *([self.method] if self.method else []), str(self.number)])


def parsed(text: str) -> Selection | None:
    """The selection that a text says; None for an empty one. InputError for anything else."""
    if not text:
        return None
    found = _WRITTEN.fullmatch(text)
    if found is None:
        raise InputError(f"{text[:40]!r} cannot be selected: write track:METHOD:ID or key_frame:METHOD:EXPOSURE")
    return Selection("track" if found[1] == "track" else "key_frame", found[2] or "", int(found[3]))
