"""The tab Explain: a verdict for each method at the frame shown, the checks that failed, details folded, and the events
of the run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import viser

from ispom.methods import Config

from ...engine.history.record import ExposureRecord
from ...engine.run_events.event import RunEvent, event_kinds, with_bookmarks
from ...presentation import colours
from ...session.current_run import CurrentRun
from ...session.state import State
from ...views.viser.panels import Panel, renderer
from ..bookmarks.service import Bookmarks
from ..branches.branches import changes
from ..branches.state import Branches
from ..events.commands import StepToEvent
from ..lessons.state import Lessons
from ..plots.commands import Plots
from .card import Card, cards

if TYPE_CHECKING:
    from ...session.session import Session

TAB = "Explain"
AROUND = 60
"""Of a run with more events than twice this, those nearest to the frame shown are listed."""
FOLDERS = {"checks.html": "All checks", "steps.html": "Steps and times", "numbers.html": "Tracks and numbers"}
render = renderer(__package__)


Latest = dict[tuple[CurrentRun, int, str], ExposureRecord]
"""By run, frame and method."""


class ExplainPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session = session
        self._verdicts = gui.add_html("")
        self._details: dict[str, viser.GuiHtmlHandle] = {}
        for template, label in FOLDERS.items():
            with gui.add_folder(label, expand_by_default=False):
                self._details[template] = gui.add_html("")
        hint = "The next frame with a warning or a loss. Frames are computed until there is one."
        self._next = gui.add_button("Run to the next anomaly", icon=viser.Icon.ALERT_TRIANGLE, hint=hint, color="gray")
        self._next.on_click(lambda _: session.post(StepToEvent(alarming=True)))
        self._shown: tuple[object, ...] = ()
        """What the texts were made from."""
        self._latest: Latest = {}
        """Records that were read for methods that do not step on the frame shown."""

    def show(self, state: State) -> None:
        run = self._session.run
        count = 0 if run is None else len(run.events)
        shown = (
            state.displayed,
            state[Plots].names,
            state.methods,
            state.config,
            _waiting(state),
            count,
            state.notes,
            tuple(state[Branches].curves.values()),
        )
        if shown == self._shown:
            return
        self._shown = shown
        open_question = state[Lessons].covers
        latest = {} if run is None or open_question else self._latest_records(run, state)
        values = report_values(state, latest, () if open_question else state.methods)
        _put(self._verdicts, "verdicts.html", values | {"ongoing": {} if open_question else ongoing(run, state.index)})
        for template, handle in self._details.items():
            _put(handle, template, values)

    def _latest_records(self, run: CurrentRun, state: State) -> Mapping[str, ExposureRecord]:
        self._latest = latest_records(run, state, self._latest)
        return {method: record for (_, _, method), record in self._latest.items()}


class EventsPanel:
    """Below what other features say of the frame shown: a list that may be long."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session = session
        self._events = gui.add_html("")
        self._shown: tuple[object, ...] = ()

    def show(self, state: State) -> None:
        run = None if state[Lessons].covers else self._session.run
        count = 0 if run is None else len(run.events)
        shown = (
            state.run,
            state.index,
            state.computed,
            state.ended,
            state[Lessons].covers,
            count,
            state[Bookmarks].marks,
        )
        if shown != self._shown:
            self._shown = shown
            _put(self._events, "events.html", event_values(state, run))


def latest_records(run: CurrentRun, state: State, known: Latest) -> Latest:
    """Of methods that did not step at the frame shown, the record of their last step before it; `known` ones are not
    read again."""
    if state.displayed is None:
        return {}
    stepped = {step.method for step in state.displayed.steps}
    places = {m: run.series.last_step(m, state.index) for m in state.methods if m not in stepped}
    keys = [(run, at, method) for method, at in places.items() if at is not None]
    return {key: known.get(key) or run.history[key[1]] for key in keys}


def report(state: State) -> str:
    """The explanation of the frame shown, without the events, as HTML."""
    values = report_values(state, {}, ())
    return "".join(render(t, **values | {"ongoing": {}}) for t in ("verdicts.html", *FOLDERS))


def report_values(state: State, latest: Mapping[str, ExposureRecord], methods: tuple[str, ...]) -> dict[str, Any]:
    """What the templates of the frame shown take."""
    record = state.displayed
    curves = {} if state[Lessons].covers else state[Branches].curves
    found: list[Card] = [] if record is None else cards(record, methods, latest, curves)
    return {
        "record": record,
        "time_s": f"{state.time_s:.2f}",
        "cards": found,
        "settings": changes((state.methods, Config()), (state.methods, state.config)),
        "plotted": state[Plots].names,
        "waiting": _waiting(state),
        "notes": (state.failure,) if state.phase == "failed" else state.notes,
    }


def ongoing(run: CurrentRun | None, index: int) -> dict[str, list[Any]]:
    """By method: warnings of earlier frames that still hold at this one."""
    found: dict[str, list[Any]] = {}
    for event in () if run is None else run.events.events:
        holds = event.frame < index and (event.until is None or event.until > index)
        if holds and event.severity.alarming and event.kind != "lost":
            found.setdefault(event.method, []).append(event)
    return found


def event_values(state: State, run: CurrentRun | None, around: int | None = None) -> dict[str, Any]:
    """What the template of the events takes: those nearest to the frame shown, so many (AROUND) before and after it."""
    around = AROUND if around is None else around
    events = [] if run is None else with_bookmarks(run.events.events, state[Bookmarks].marks)
    first = next((i for i, event in enumerate(events) if event.frame >= state.index), len(events))
    start, stop = max(0, first - around), first + around
    return {
        "rows": [
            {
                "event": event,
                "label": colours.label(event.method) if event.method else "",
                "help": event_kinds()[event.kind].help,
                "frames": _frames(event),
                "here": event.frame == state.index,
            }
            for event in events[start:stop]
        ],
        "earlier": start,
        "later": max(0, len(events) - stop),
        "omitted": 0 if run is None else run.events.omitted,
        "computed": state.computed,
    }


def _frames(event: RunEvent) -> str:
    """Its frame, or its first and last one."""
    if not event_kinds()[event.kind].lasts or event.length == 1:
        return str(event.frame)
    return f"{event.frame}–" + (str(event.until - 1) if event.until is not None else "")


def _put(handle: viser.GuiHtmlHandle, template: str, values: Mapping[str, Any]) -> None:
    text = render(template, **values)
    if text != handle.content:
        handle.content = text


def _waiting(state: State) -> str:
    """What the first frame waits for; empty where none is coming."""
    if state.displayed is not None or not (state.playing or state.activity is not None):
        return ""
    return f"Waiting for the first frame. {state.activity.text} …" if state.activity else "Waiting for the first frame."


PANELS = (Panel(TAB, 100, ExplainPanel), Panel(TAB, 120, EventsPanel))
