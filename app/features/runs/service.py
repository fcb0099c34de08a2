"""Runs of the table, as branches of the session."""

from __future__ import annotations

from os.path import abspath
from pathlib import PurePath

import numpy as np

from ispom.errors import InputError

from ...session import moves
from ...session.branches.kept import Kept
from ...session.branches.service import BranchService
from ...session.branches.state import Branches
from ...session.current_run import CurrentRun
from ...session.service import Service
from ..recording.listing import Known
from ..recording.service import RecordingService
from ..recording.state import Recordings
from .live import kept_of


class RunsService(Service):
    place = 70
    _waiting: tuple[int, int] | None = None
    """Two branches that are compared when the first, which is shown, has come as far as the second."""

    def compare(self, a: str, b: str) -> None:
        """Shows run `a` and compares it with `b`. InputError if they are of different sources, or one of them cannot be
        opened."""
        self.session.service(RecordingService).show()  # another process may have finished a run
        named = {kept.name: kept.source for kept in self.state[Recordings].listed}
        if a in named and b in named and named[a] != named[b]:
            raise InputError(f"{a} is a run on {named[a]}, and {b} on {named[b]}: choose two runs on one source")
        numbers = [self.branch_of(key) for key in (a, b)]
        if numbers == [None, None]:
            if (kept := self._kept(a)) is not None:
                self.show_kept(a)
                numbers[0] = kept[1]
            else:
                self.session.screen.open(self._source(a), None)
                numbers[0] = 0
        shown, other = (self._with_run(key) if n is None else n for key, n in zip((a, b), numbers, strict=True))
        branches = self.session.service(BranchService)
        first, count = shown, _computed(branches.run_of(other))
        if _computed(branches.run_of(shown)) > count:
            first, count = other, _computed(branches.run_of(shown))
        run = branches.run_of(first)
        if run is not None and not run.done and len(run.history) < count:
            self._show(first)
            self.session.player.move(*moves.seek(run, count - 1))
        self._waiting = shown, other

    def show_kept(self, key: str) -> None:
        """InputError for a run that is not kept any more."""
        kept = self._kept(key)
        if kept is None:
            raise InputError("this run is not in the session any more: choose another one")
        self.session.service(BranchService).show_again(*kept)

    def _kept(self, key: str) -> tuple[Kept, int] | None:
        return kept_of(key, self.session.service(BranchService).kept)

    def _show(self, number: int) -> None:
        """The views load a run again when it is shown: not for nothing."""
        if self.state[Branches].shown != number:
            self.session.service(BranchService).show(number)

    def watch(self) -> None:
        """Begins the comparison when both runs have the same frames, or a person has stopped the computation."""
        if self._waiting is None or self.state.target is not None:
            return
        (shown, other), self._waiting = self._waiting, None
        branches = self.session.service(BranchService)
        if branches.run_of(shown) is None or branches.run_of(other) is None:
            return  # another source was opened meanwhile
        self._show(shown)
        branches.compare(other)

    @property
    def impatient(self) -> bool:
        return self._waiting is not None and self.state.target is None

    def branch_of(self, key: str) -> int | None:
        """The number of the branch that a row of the runs table is; None if it is kept, or to be read from its folder.

        InputError for a branch that was deleted.
        """
        kind, _, number = key.partition(":")
        run_of = self.session.service(BranchService).run_of
        if self._kept(key) is not None:
            return None
        if kind == "live":
            if not number.isdecimal() or run_of(int(number)) is None:
                raise InputError("this run is not in the session any more: choose another one")
            return int(number)
        path = abspath(self.session.setup.recordings / key)
        runs = ((b.number, run_of(b.number)) for b in self.state[Branches].all)
        return next((n for n, run in runs if run and run.stored and abspath(run.stored.path) == path), None)

    def _with_run(self, name: str) -> int:
        """The number of the branch that a run which was closed, or one of the recordings folder, becomes."""
        kept, run = self._kept(name), self.run
        if kept is not None:
            found: CurrentRun | None = kept[0].runs[kept[1]]
            name = next(b.name for b in kept[0].branches if b.number == kept[1])
        else:
            found = self.session.screen.opener.stored(self._source(name), self.session.setup.history_bytes)
        if found is None or run is None:
            raise InputError(f"{name} holds no run: choose another one")
        times_ns = [each.playback.sequence.times_ns[: len(found.history)] for each in (run, found)]
        if not np.array_equal(times_ns[0], times_ns[1]):
            raise InputError(f"{name} has other frames than the run that is shown: choose two runs on one source")
        return self.session.service(BranchService).add(found, PurePath(name).name, 0, (), reproducible=True, show=False)

    def _source(self, name: str) -> str:
        return Known(self.session.setup.recordings).source(name, self.state)


def _computed(run: CurrentRun | None) -> int:
    return 0 if run is None else len(run.history)
