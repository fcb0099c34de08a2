"""What the tab Explain shows: a verdict for each method at the frame shown, the checks that failed, details, and the
events of the run."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from ispom.methods import Config

from ...engine.history.record import ExposureRecord
from ...engine.run_events.event import RunEvent, event_kinds, with_bookmarks
from ...presentation import colours
from ...session.branches.branches import changes
from ...session.branches.state import Branches
from ...session.current_run import CurrentRun
from ...session.state import State
from ...views.web.view_values import View
from ..bookmarks.service import Bookmarks
from ..plots.commands import Plots
from .card import Card, CheckRow, Details, cards

TAB = "Explain"
AROUND = 60
"""Least number of events listed before and after the frame shown, of a run with more than three times as many."""


class Since(msgspec.Struct, frozen=True):
    """A warning of an earlier frame that still holds."""

    frame: int
    headline: str
    sentence: str


class MethodCard(msgspec.Struct, frozen=True):
    """How a method does: its verdict, the check that decided it, and the others that failed."""

    method: str
    label: str
    colour: str
    severity: str
    headline: str
    detail: str
    tag: str
    when: str
    decisive: CheckRow | None
    failed: tuple[CheckRow, ...]
    ongoing: tuple[Since, ...]
    details: Details | None


class ExplainView(msgspec.Struct, frozen=True):
    """The verdicts at a frame; `frame` is -1 before the first."""

    frame: int
    kind: str
    time_s: float
    waiting: str
    """What the first frame waits for; empty where none is coming."""
    skipped: str
    thinned: bool
    cards: tuple[MethodCard, ...]
    settings: tuple[str, ...]
    plotted: tuple[str, ...]
    notes: tuple[str, ...]


class EventRow(msgspec.Struct, frozen=True):
    frame: int
    frames: str
    """Its frame, or its first and last one."""
    label: str
    sentence: str
    severity: str
    alarming: bool
    help: str


class EventsView(msgspec.Struct, frozen=True):
    """The events nearest to the frame shown, and the numbers of those that are not listed."""

    frame: int
    rows: tuple[EventRow, ...]
    earlier: int
    later: int
    omitted: int
    computed: int


def explain(state: State, run: CurrentRun | None, frame: int) -> ExplainView:
    """The verdicts, and all that the methods did."""
    record = state.displayed
    methods = state.methods if run is not None else ()
    latest = {} if run is None else latest_records(run, state)
    curves = state[Branches].curves if run is not None else {}
    since = ongoing(run, frame)
    found = () if record is None else cards(record, methods, latest, curves)
    return ExplainView(
        frame=frame,
        kind="" if record is None else record.kind,
        time_s=round(state.time_s, 2),
        waiting=_waiting(state),
        skipped="" if record is None else record.skipped,
        thinned=record is not None and record.thinned,
        cards=tuple(_card(card, since.get(card.verdict.method, ())) for card in found),
        settings=() if run is None else changes((methods, Config()), (methods, state.config)),
        plotted=state[Plots].names,
        notes=(state.failure,) if state.phase == "failed" else state.notes,
    )


def events(state: State, run: CurrentRun | None, frame: int) -> EventsView:
    """Those nearest to the frame, at least AROUND before and after it. A step changes them rarely, for each change is
    sent."""
    found = [] if run is None else with_bookmarks(run.events.events, state[Bookmarks].marks)
    first = next((i for i, event in enumerate(found) if event.frame >= frame), len(found))
    start = max(0, (first // AROUND - 1) * AROUND)
    stop = start + 3 * AROUND
    omitted = 0 if run is None else run.events.omitted
    rows = tuple(_row(event) for event in found[start:stop])
    return EventsView(frame, rows, start, max(0, len(found) - stop), omitted, state.computed)


def latest_records(run: CurrentRun, state: State) -> Mapping[str, ExposureRecord]:
    """Of methods that did not step at the frame shown, the record of their last step before it."""
    if state.displayed is None:
        return {}
    stepped = {step.method for step in state.displayed.steps}
    places = {m: run.series.last_step(m, state.index) for m in state.methods if m not in stepped}
    return {method: run.history[at] for method, at in places.items() if at is not None}


def ongoing(run: CurrentRun | None, index: int) -> dict[str, tuple[Since, ...]]:
    """By method: warnings of earlier frames that still hold at this one."""
    found: dict[str, tuple[Since, ...]] = {}
    for event in () if run is None else run.events.events:
        holds = event.frame < index and (event.until is None or event.until > index)
        if holds and event.severity.alarming and event.kind != "lost":
            since = Since(event.frame, event.sentence.split(":")[0], event.sentence)
            found[event.method] = (*found.get(event.method, ()), since)
    return found


def _waiting(state: State) -> str:
    if state.displayed is not None or not (state.playing or state.activity is not None):
        return ""
    return f"Waiting for the first frame. {state.activity.text} …" if state.activity else "Waiting for the first frame."


def _card(card: Card, since: tuple[Since, ...]) -> MethodCard:
    verdict = card.verdict
    return MethodCard(
        method=verdict.method,
        label=card.label,
        colour=card.colour,
        severity=str(verdict.severity),
        headline=verdict.headline,
        detail=verdict.detail,
        tag=card.tag,
        when=card.when,
        decisive=card.decisive,
        failed=card.failed,
        ongoing=tuple(each for each in since if each.headline != verdict.headline),
        details=card.details,
    )


def _row(event: RunEvent) -> EventRow:
    kind = event_kinds()[event.kind]
    frames = str(event.frame)
    if kind.lasts and event.length != 1:
        frames += "–" + (str(event.until - 1) if event.until is not None else "")
    label = colours.label(event.method) if event.method else ""
    return EventRow(event.frame, frames, label, event.sentence, str(event.severity), event.severity.alarming, kind.help)


VIEWS = (View("explain", TAB, 100, explain), View("events", TAB, 120, events))
