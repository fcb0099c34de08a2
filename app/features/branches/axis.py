"""Where branches begin, on the time axis."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

from ...presentation import colours
from ...session.branches.state import Branches
from ...session.current_run import CurrentRun
from ...session.state import State
from ...views.web.time_axis import Mark, Marks


class BranchMarks(Marks):
    name: ClassVar[str] = "branches"
    sign: ClassVar[Literal["flag"]] = "flag"

    def marked(self, state: State, run: CurrentRun) -> Iterator[Mark]:
        for branch in state[Branches].all:
            if branch.parent is not None:
                yield Mark(branch.at, f"{branch.name} begins", colour=colours.css(branch.colour))


MARKS = (BranchMarks,)
