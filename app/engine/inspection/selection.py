"""What a person has picked, as a text that an address can carry: `track:monocular:181`, `key_frame:stereo:40`,
`tracks:stereo:12,15,17`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from ispom.errors import InputError

Kind = Literal["track", "key_frame", "tracks"]
MOST = 200
"""Tracks that can be selected together."""
_WRITTEN = re.compile(rf"(track|key_frame|tracks):(?:([A-Za-z_][\w.-]*):)?(\d{{1,18}}(?:,\d{{1,18}}){{0,{MOST - 1}}})")


@dataclass(frozen=True)
class Selection:
    kind: Kind
    method: str
    """The method that it belongs to; empty for the first method that has it."""
    number: int
    """The id of a track, of the first one of several, or the frame of a keyframe."""
    more: tuple[int, ...] = ()
    """Ids of the other tracks, where several are selected."""

    @staticmethod
    def of_tracks(method: str, ids: tuple[int, ...]) -> Selection:
        """One track, or several: the first MOST of them."""
        return Selection("track" if len(ids) == 1 else "tracks", method, ids[0], ids[1:MOST])

    @property
    def tracks(self) -> tuple[int, ...]:
        """Ids of the selected tracks."""
        return () if self.kind == "key_frame" else (self.number, *self.more)

    def __str__(self) -> str:
        numbers = ",".join(map(str, (self.number, *self.more)))
        return ":".join([self.kind, *([self.method] if self.method else []), numbers])


def parsed(text: str) -> Selection | None:
    """The selection that a text says; None for an empty one. InputError for anything else."""
    if not text:
        return None
    found = _WRITTEN.fullmatch(text)
    kinds: dict[str, Kind] = {"track": "track", "key_frame": "key_frame", "tracks": "tracks"}
    numbers = [] if found is None else [int(number) for number in found[3].split(",")]
    if found is None or (found[1] != "tracks" and len(numbers) > 1):
        raise InputError(
            f"{text[:40]!r} cannot be selected: write track:METHOD:ID, tracks:METHOD:ID,ID or key_frame:METHOD:EXPOSURE"
        )
    return Selection(kinds[found[1]], found[2] or "", numbers[0], tuple(numbers[1:]))
