"""Break points: conditions over the quantities of a run, looked for in what is computed and waited for in the rest."""

from __future__ import annotations

from dataclasses import dataclass

from ispom.errors import InputError

from ...engine.conditions.evaluate import first_match
from ...engine.conditions.parser import Expression, parse
from ...session.commands import Command
from ...session.controller import Controller
from ...session.current_run import CurrentRun
from ...session.goals import Holds, measured
from ...session.state import Displayed, FeatureState, NoticeAdded, changed


@dataclass(frozen=True)
class Breakpoints(FeatureState):
    marked: Expression | None = None
    """The time axis marks where it holds."""


class RunUntil(Command, frozen=True):
    """Run on, as fast as possible, until this condition holds at a frame after the one that is shown."""

    condition: str

    def execute(self, session: Controller) -> None:
        """InputError if it is no condition, or the run has ended and it does not hold again."""
        run, condition = _parsed(session.run, self.condition)
        state = session.state
        index = first_match(condition, run.series, range(state.index + 1, state.computed))
        if index is not None:
            shown = changed(playing=False, target=None), Displayed(run.history[index])
            moved = *shown, NoticeAdded(measured(condition, run, index), "info")
        elif state.computed > run.last:
            raise InputError(f"{condition.text} holds at no frame after {max(state.index, 0)}")
        else:
            moved = (changed(playing=False, target=run.last, until=Holds(condition)),)
        session.store.put(Breakpoints(condition))
        session.player.move(*moved)


class FindMatch(Command, frozen=True):
    """Show the next (or, backwards, the previous) of the computed frames at which this condition holds."""

    condition: str
    forwards: bool = True

    def execute(self, session: Controller) -> None:
        """Pauses. InputError if it is no condition, or never holds there."""
        run, condition = _parsed(session.run, self.condition)
        state = session.state
        among = range(state.index + 1, state.computed) if self.forwards else range(state.index - 1, -1, -1)
        index = first_match(condition, run.series, among)
        if index is None:
            where = "after" if self.forwards else "before"
            raise InputError(f"{condition.text} holds at no computed frame {where} {max(state.index, 0)}")
        session.store.put(Breakpoints(condition))
        session.player.move(changed(playing=False, target=None), Displayed(run.history[index]))


def _parsed(run: CurrentRun | None, condition: str) -> tuple[CurrentRun, Expression]:
    if run is None:
        raise InputError("there is nothing to run yet: open a source first")
    if not condition.strip():
        raise InputError('there is no condition: write one, such as stereo.status == "lost"')
    return run, parse(condition.strip(), run.series.quantities)
