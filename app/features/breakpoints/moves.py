"""Break points: conditions over the quantities of a run, looked for in what is computed and waited for in the rest."""

from __future__ import annotations

from ispom.errors import InputError

from ...engine.conditions.evaluate import values
from ...engine.conditions.matches import first_match, matches
from ...engine.conditions.parser import Expression, parse
from ...engine.conditions.until import shown
from ...session.current_run import CurrentRun
from ...session.state import Displayed, Event, NoticeAdded, State, changed
from ..events import moves as event_moves
from ..events.commands import NextEvent


def find(state: State, run: CurrentRun | None, condition: str, *, forwards: bool) -> tuple[Event, ...]:
    """Pause, and show the nearest computed exposure at which the condition holds, in this direction.

    InputError where it is no condition, or never holds there.
    """
    run, expression = _asked(run, condition)
    among = range(state.index + 1, state.computed) if forwards else range(state.index - 1, -1, -1)
    index = first_match(expression, run.series, among)
    if index is None:
        where = "after" if forwards else "before"
        raise InputError(f"{expression.text} holds at no computed exposure {where} {max(state.index, 0)}")
    return changed(playing=False, target=None, marked=expression), Displayed(run.history[index])


def run_until(state: State, run: CurrentRun | None, condition: str) -> tuple[Event, ...]:
    """Show the next exposure at which the condition holds, be it computed already or not."""
    run, expression = _asked(run, condition)
    index = first_match(expression, run.series, range(state.index + 1, state.computed))
    if index is not None:
        moved = changed(playing=False, target=None, marked=expression), Displayed(run.history[index])
        return *moved, reached(expression, run, index)
    last = run.last
    if state.computed > last:
        raise InputError(f"{expression.text} holds at no exposure after {max(state.index, 0)}")
    return (changed(playing=False, target=last, until=expression, marked=expression),)


def after_step(state: State, run: CurrentRun, target: int) -> tuple[Event, ...]:
    """What the newest exposure means for a move: its condition holds, its target is reached, or nothing."""
    last, condition = len(run.series) - 1, state.until
    if isinstance(condition, NextEvent):
        if found := event_moves.after_step(state, run, condition):
            return found
        missed = event_moves.none_left(run.events.events, last + 1, forwards=True, alarming=condition.alarming)
        return () if last < target else (changed(target=None), NoticeAdded(missed, "info"))
    if condition is not None and matches(condition, run.series, last):
        return changed(target=None), reached(condition, run, last)
    if last < target:
        return ()
    missed = () if condition is None else (NoticeAdded(f"{condition.text} held at no exposure up to the end", "info"),)
    return changed(target=None), *missed


def reached(expression: Expression, run: CurrentRun, index: int) -> NoticeAdded:
    """What was measured where the condition held."""
    found = values(expression, run.series.row(index, expression.quantities))
    said = ", ".join(f"{q.name} {shown(found[q.name], q.unit)}" for q in expression.quantities)
    return NoticeAdded(f"stopped at exposure {index}: {said}", "info")


def _asked(run: CurrentRun | None, condition: str) -> tuple[CurrentRun, Expression]:
    if run is None:
        raise InputError("there is nothing to run yet: open a source first")
    if not condition.strip():
        raise InputError('there is no condition: write one, such as stereo.status == "lost"')
    return run, parse(condition.strip(), run.series.quantities)
