"""The runs of the branches. Except for `run_of` and `kept`, it is used in the worker's thread only."""

from __future__ import annotations

from dataclasses import replace

from ispom.errors import InputError
from ispom.methods import Config, in_order

from ..controller import Controller
from ..current_run import CurrentRun
from ..service import Service
from ..sources.folders import run_name
from ..state import Resumed, State
from .accuracy import Accuracy
from .branches import FIRST, MOST, NAME_LENGTH, STORED, Branch, changes
from .comparison import advanced, begin
from .kept import Kept, limited
from .state import Branches


class BranchService(Service):
    """Keeps the runs of the branches by number. Only the one that is shown has its full memory."""

    place = 10

    def __init__(self, session: Controller) -> None:
        super().__init__(session)
        self._accuracy = Accuracy(self.store, self.run_of)
        self._runs: dict[int, CurrentRun] = {}
        self._next = 0
        self.kept: tuple[Kept, ...] = ()
        """Closed sources with their runs, oldest first. Any thread may read it."""
        self._keeps = 0
        self._again: tuple[Kept, int] | None = None
        """The closed source that is about to be shown again, and the number of the branch to show."""

    def keep(self, before: State) -> None:
        """Keeps the branches of the source that is closed, each with little memory."""
        known = before[Branches].all
        if not known or not self._runs:
            return
        for run in self._runs.values():
            run.rest()
        self._keeps += 1
        name = before.name or run_name(before.source)
        kept = Kept(self._keeps, before.source, name, before.source_options, known, self._runs)
        self.kept = limited((*self.kept, kept))

    def show_again(self, kept: Kept, number: int) -> None:
        """Shows a branch of a closed source again, and lists the source's other branches."""
        self.kept = tuple(each for each in self.kept if each is not kept)
        self._again = kept, number
        self.session.screen.show_again(kept.runs[number], kept.source, kept.options)

    def opened(self, run: CurrentRun) -> None:
        """Replaces the branches by those of the new run. A run that is over is shown at its end."""
        if self._again is not None:
            (kept, number), self._again = self._again, None
            self._runs, self._next = dict(kept.runs), max(kept.runs) + 1
            run.wake()
            self.store.put(replace(self._branches, all=kept.branches, shown=number))
            self.session.player.move(Resumed(run.opened, number, len(run.history), run.history.last, run.done))
            return
        self._runs, self._next = {0: run}, 1
        if run.history:
            known = {"name": FIRST if run.stored is None else STORED, "computed": len(run.history), "tally": run.tally}
            self.store.put(self._branches.with_branch(0, **known))
            shown = run.history[0 if run.stored is None else -1]
            self.session.player.move(Resumed(run.opened, 0, len(run.history), shown, run.done))

    def run_of(self, number: int) -> CurrentRun | None:
        """Returns the run of a branch; None for an unknown one. Any thread may call it."""
        return self._runs.get(number)

    @property
    def _branches(self) -> Branches:
        return self.state[Branches]

    def fork(self, methods: tuple[str, ...], config: Config, name: str) -> None:
        """Forks the run after the frame that is shown, and shows the fork at this frame. InputError where that is not
        possible."""
        state = self.state
        run = self._shown()
        if not methods:
            raise InputError("no method is chosen: switch on at least one")
        if run.live:
            raise InputError("a live source cannot be forked while it runs: wait for its end, or open its recording")
        if state.index + 1 >= state.total:
            raise InputError("this is the last frame, after which nothing is left to run: step back before forking")
        before = run.playback
        methods = in_order(methods)
        fork = run.forked(state.index + 1, methods, config)
        differences = changes((before.methods, before.config), (methods, config))
        self.add(fork, name, state.index + 1, differences)

    def add(
        self,
        run: CurrentRun,
        name: str,
        at: int,
        differences: tuple[str, ...],
        *,
        reproducible: bool = False,
        show: bool = True,
    ) -> int:
        """Adds a run as a branch of the one that is shown, from frame `at` on. InputError beyond MOST."""
        if len(self._runs) >= MOST:
            raise InputError(f"there are {MOST} branches: delete one first")
        number, self._next = self._next, self._next + 1
        self._runs[number] = run
        named = _name(name) or f"branch {number}"
        branch = Branch(number, named, self._branches.shown, at, differences, len(run.history), run.tally)
        branch = replace(branch, reproducible=reproducible)
        self.store.put(replace(self._branches, all=(*self._branches.all, branch)))
        if show:
            self.show(number)
        else:
            run.rest()
        return number

    def show(self, number: int) -> None:
        """Shows a branch at the frame that is shown now, or at its last one. InputError for an unknown branch."""
        run, state = self._found(number), self.state
        self._shown().rest()
        run.wake()
        last = len(run.history) - 1
        displayed = run.history[min(state.index, last)] if last >= 0 and state.index >= 0 else None
        self.session.screen.show(run, Resumed(run.opened, number, last + 1, displayed, run.done))

    def rename(self, number: int, name: str) -> None:
        self._found(number)
        if not _name(name):
            raise InputError("a branch has no name: give it one")
        self._change(number, name=_name(name))

    def hide(self, number: int, hidden: bool) -> None:
        self._found(number)
        self._change(number, hidden=hidden)

    def delete(self, number: int) -> None:
        """Deletes a branch. InputError for the one that is shown."""
        self._found(number)
        if number == self._branches.shown:
            raise InputError("the branch that is shown cannot be deleted: show another one first")
        del self._runs[number]
        compared = self._branches.comparison
        if compared is not None and number in (compared.shown, compared.other):
            compared = None
        left = self._accuracy.with_curves(b for b in self._branches.all if b.number != number)
        self.store.put(replace(self._branches, all=left, comparison=compared))

    def compare(self, number: int) -> None:
        """Begins to compare the branch that is shown with another one. InputError where there is nothing to compare."""
        known, other = self._branches, self._found(number)
        begun = begin(known.all, known.shown, number, self._shown(), other)
        self.store.put(replace(known, comparison=begun))

    @property
    def impatient(self) -> bool:
        """Returns whether something is left to compare."""
        compared = self._branches.comparison
        return compared is not None and not compared.finished

    def watch(self) -> None:
        """Compares a little, and measures what changed."""
        compared = self._branches.comparison
        if compared is not None and not compared.finished:
            found = None  # where this fails, it is not tried again
            try:
                found = advanced(compared, self._found(compared.shown), self._found(compared.other))
            finally:
                self.store.put(replace(self._branches, comparison=found))
        self._accuracy.watch()

    def loss(self) -> list[str]:
        """Returns a phrase about forks that neither a file nor the same steps could restore."""
        kept = self.session.kept_branches
        own = [b for b in self._branches.all if b.parent is not None and not b.reproducible and b.number not in kept]
        names = ", ".join(f"“{branch.name}”" for branch in own)
        return [f"the branch {names}" if len(own) == 1 else f"the {len(own)} branches {names}"] if own else []

    def _change(self, number: int, **values: object) -> None:
        self.store.put(self._branches.with_branch(number, **values))

    def _shown(self) -> CurrentRun:
        return self._found(self._branches.shown)

    def _found(self, number: int) -> CurrentRun:
        if number not in self._runs:
            raise InputError("there is no such branch: choose one of the list")
        return self._runs[number]


def _name(name: str) -> str:
    """Returns the name as plain text on one line, shortened if it is too long."""
    return " ".join(name.split())[:NAME_LENGTH]
