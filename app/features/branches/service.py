"""The runs behind the branches. Used in the worker's thread, but for `run`."""

from __future__ import annotations

from dataclasses import replace

from ispom.errors import InputError
from ispom.methods import Config, in_order

from ...session.current_run import CurrentRun
from ...session.state import Event, Resumed, changed
from ...session.store import Store
from ..flicker.flicker import Side, sides
from .branches import MOST, NAME_LENGTH, STORED, Branch, changes
from .comparison import advanced, begin


class BranchDesk:
    """Branches by number; the one that is shown has memory, the others rest."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._runs: dict[int, CurrentRun] = {}
        self._next = 0

    def begin(self, run: CurrentRun) -> None:
        """Another run from the first exposure on: the branches of the one before are gone."""
        self._runs, self._next = {0: run}, 1

    def reviewed(self) -> tuple[Event, ...]:
        """How the first run, which is over, is shown: at its end."""
        run, first = self._found(0), self._store.state.branches[0]
        known = replace(first, name=STORED, computed=len(run.history), tally=run.tally)
        return changed(branches=(known,)), Resumed(run.opened, 0, len(run.history), run.history.last, run.done)

    def run(self, number: int) -> CurrentRun | None:
        return self._runs.get(number)

    @property
    def sides(self) -> tuple[Side, ...]:
        """What can flicker: the methods of each branch."""
        return sides(self._store.state.branches, lambda number: self._found(number).opened.methods)

    def fork(self, methods: tuple[str, ...], config: Config, name: str) -> tuple[CurrentRun, Resumed]:
        """From the state after the exposure that is shown; as `show`. InputError where that cannot be."""
        state = self._store.state
        run = self._shown()
        if not methods:
            raise InputError("no method is chosen: switch on at least one")
        if run.live:
            raise InputError("a live source cannot be forked while it runs: wait for its end, or open its recording")
        if state.index + 1 >= state.total:
            raise InputError("this is the last exposure, after which nothing is left to run: step back before forking")
        before = run.playback
        methods = in_order(methods)
        fork = run.forked(state.index + 1, methods, config)
        differences = changes((before.methods, before.config), (methods, config))
        return self.add(fork, name, state.index + 1, differences)

    def add(
        self, run: CurrentRun, name: str, at: int, differences: tuple[str, ...], *, reproducible: bool = False
    ) -> tuple[CurrentRun, Resumed]:
        """A run as a branch of the one that is shown, from exposure `at` on; as `show`. InputError beyond MOST."""
        state = self._store.state
        if len(self._runs) >= MOST:
            raise InputError(f"there are {MOST} branches: delete one first")
        number, self._next = self._next, self._next + 1
        self._runs[number] = run
        named = _name(name) or f"branch {number}"
        branch = Branch(number, named, state.branch, at, differences, len(run.history), run.tally)
        self._store.set(branches=(*state.branches, replace(branch, reproducible=reproducible)))
        return self.show(number)

    def show(self, number: int) -> tuple[CurrentRun, Resumed]:
        """The run of a branch, with its memory; and how it is shown, at the exposure that is shown now or its last."""
        run, state = self._found(number), self._store.state
        self._shown().rest()
        run.wake()
        last = len(run.history) - 1
        displayed = run.history[min(state.index, last)] if last >= 0 and state.index >= 0 else None
        return run, Resumed(run.opened, number, last + 1, displayed, run.done)

    def rename(self, number: int, name: str) -> None:
        self._found(number)
        if not _name(name):
            raise InputError("a branch has no name: give it one")
        self._change(number, name=_name(name))

    def hide(self, number: int, hidden: bool) -> None:
        self._found(number)
        self._change(number, hidden=hidden)

    def delete(self, number: int) -> None:
        """InputError for the one that is shown."""
        self._found(number)
        if number == self._store.state.branch:
            raise InputError("the branch that is shown cannot be deleted: show another one first")
        del self._runs[number]
        compared = self._store.state.comparison
        if compared is not None and number in (compared.shown, compared.other):
            self._store.set(comparison=None)
        flicker = self._store.state.flicker
        if flicker is not None and number in (flicker.a.branch, flicker.b.branch):
            self._store.set(flicker=None)
        self._store.set(branches=tuple(b for b in self._store.state.branches if b.number != number))

    def compare(self, number: int) -> None:
        """The branch that is shown with another one, from now on. InputError where there is nothing to compare."""
        state, other = self._store.state, self._found(number)
        self._store.set(comparison=begin(state.branches, state.branch, number, self._shown(), other))

    @property
    def comparing(self) -> bool:
        compared = self._store.state.comparison
        return compared is not None and not compared.finished

    def compare_on(self) -> None:
        """A little of it, where there is something left."""
        compared = self._store.state.comparison
        if compared is not None and not compared.finished:
            found = None  # where this fails, it is not tried again
            try:
                found = advanced(compared, self._found(compared.shown), self._found(compared.other))
            finally:
                self._store.set(comparison=found)

    def _change(self, number: int, **values: object) -> None:
        branches = self._store.state.branches
        self._store.set(branches=tuple(replace(b, **values) if b.number == number else b for b in branches))  # type: ignore[arg-type]

    def _shown(self) -> CurrentRun:
        return self._found(self._store.state.branch)

    def _found(self, number: int) -> CurrentRun:
        if number not in self._runs:
            raise InputError("there is no such branch: choose one of the list")
        return self._runs[number]


def _name(given: str) -> str:
    """Plain, on one line, not too long."""
    return " ".join(given.split())[:NAME_LENGTH]
