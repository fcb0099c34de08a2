"""Which points decided this pose: the answer, and a row for each part; a click shows its tracks in the image."""

from __future__ import annotations

import msgspec

from ...engine.inspection.selection import Selection
from ...presentation import colours
from ...session.current_run import CurrentRun
from ...session.state import State
from ...views.web.view_values import View
from .found import PoseBlame
from .state import Blames
from .words import answer, size, unit_of


class BlameRow(msgspec.Struct, frozen=True):
    """A part that was left out."""

    name: str
    size: str
    """By how much it moved the pose."""
    select: str
    """Its tracks, as they are selected; empty for none."""
    seek: int | None
    """Its frame."""


class MethodBlame(msgspec.Struct, frozen=True):
    label: str
    colour: str
    frame: int
    """Of its pose, which may be before the frame shown."""
    said: tuple[str, ...]
    rows: tuple[BlameRow, ...]


class BlameView(msgspec.Struct, frozen=True):
    """Of the frame shown; none before somebody asks."""

    possible: bool
    """Whether there is a frame to ask about."""
    frame: int
    doing: str
    """What is done for the answer now; empty once it is there."""
    methods: tuple[MethodBlame, ...]
    silent: tuple[str, ...]
    """Why other methods have no answer."""


def blame(state: State, run: CurrentRun | None, frame: int) -> BlameView:
    """What is known of the frame shown."""
    found = state[Blames].at(state) if run is not None else Blames()
    silent = tuple(f"{reason[:1].upper()}{reason[1:]}." for _, reason in found.silent)
    possible = run is not None and frame >= 0
    return BlameView(possible, frame, found.doing, tuple(method_blame(each) for each in found.found), silent)


def method_blame(of: PoseBlame) -> MethodBlame:
    """The answer of one method, and its parts."""
    unit = unit_of(of)
    rows = tuple(
        BlameRow(
            of.called(each),
            size(of, each.shift.size, unit),
            str(Selection.of_tracks(of.tracked_by, each.part.tracks)) if each.part.tracks else "",
            of.index_of(each.part.time_ns) if each.part.time_ns is not None else None,
        )
        for each in of.listed()
    )
    return MethodBlame(colours.label(of.method), colours.css(colours.of(of.method)), of.index, tuple(answer(of)), rows)


VIEWS = (View("blame", "Explain", 102, blame),)
