"""The tab Explain on viser without a browser: verdicts first, events with what a click does."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import viser
from ispom_app.engine.events import Bookmark
from ispom_app.engine.history.quantities import NO_ROW, row_after
from ispom_app.engine.playback import Playback
from ispom_app.engine.run_events.log import EventLog
from ispom_app.features.events.commands import StepToEvent
from ispom_app.features.explain.panel import EventsPanel, ExplainPanel, ongoing
from ispom_app.session import commands as do
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.state import Activity, State, reduce

from ispom.estimators.modern.monocular import checks
from ispom.types import Status, Step
from tests import doubles
from tests.alone import METHODS
from tests.app.helpers import with_values


@pytest.fixture(scope="module")
def run() -> CurrentRun:
    playback = Playback(
        doubles.sequence(40), METHODS, builder=lambda _, methods, __: doubles.ensemble(methods, doubles.FullEstimator)
    )
    found = CurrentRun(playback, 10**8)
    while not playback.done:
        found.step()
    return found


@pytest.fixture(scope="module")
def server() -> Iterator[viser.ViserServer]:
    found = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield found
    found.stop()


@pytest.fixture
def panel(server: viser.ViserServer, run: CurrentRun) -> ExplainPanel:
    commands: list[do.Command] = []
    session: Any = SimpleNamespace(run=run, post=commands.append, asked=commands)
    return ExplainPanel(server.gui, session)


@pytest.fixture
def listed(server: viser.ViserServer, run: CurrentRun) -> EventsPanel:
    session: Any = SimpleNamespace(run=run)
    return EventsPanel(server.gui, session)


def at(run: CurrentRun, index: int, **values: Any) -> State:
    state = reduce(State("double:40"), run.opened)
    return with_values(state, displayed=run.history[index], computed=len(run.history), **values)


def frames(text: str) -> list[int]:
    return [int(frame) for frame in re.findall(r'data-seek="(\d+)"', text)]


def test_the_first_thing_is_a_verdict_for_each_method(panel: ExplainPanel, run: CurrentRun) -> None:
    index = next(r.index for r in run.history if r.kind == "video" and r.index > 20)
    panel.show(at(run, index))
    text = panel._verdicts.content
    assert text.count('class="headline"') == len(METHODS)
    assert re.search(r"Stereo.*?at frame \d+", text, re.DOTALL), "that of the pair before, as this frame is none"
    assert text.index("Frame") < text.index('class="headline"') < text.index("data-plot")


def test_before_the_first_frame_it_says_what_that_waits_for(panel: ExplainPanel) -> None:
    compiling = Activity("Compiling: 40 %, about 20 s", 0.0)
    panel.show(replace(State("double:40"), playing=True, activity=compiling))
    assert compiling.text in panel._verdicts.content
    panel.show(replace(State("double:40"), playing=True, activity=replace(compiling, text="Compiling: 41 %")))
    assert "41 %" in panel._verdicts.content and "40 %" not in panel._verdicts.content


def test_every_event_is_a_button_that_goes_there_and_that_of_the_frame_is_marked(
    listed: EventsPanel, run: CurrentRun
) -> None:
    lost = next(e for e in run.events.events if e.kind == "lost")
    listed.show(at(run, lost.frame, bookmarks=(Bookmark(3, 3, "<b>the bus</b>"),)))
    text = listed._events.content
    assert frames(text) == sorted([3, *(e.frame for e in run.events.events)])
    assert text.count('aria-current="true"') == sum(e.frame == lost.frame for e in run.events.events)
    assert "&lt;b&gt;the bus" in text and "<b>the bus" not in text
    assert lost.sentence.split(":")[0] in text


def test_of_many_events_those_around_the_frame_are_listed(
    listed: EventsPanel, run: CurrentRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ispom_app.features.explain.panel.AROUND", 1)
    listed.show(at(run, 30))
    assert len(frames(listed._events.content)) == 2 and re.search(r"\d+ earlier", listed._events.content)


def test_while_a_question_of_a_lesson_is_open_neither_verdicts_nor_events_are_shown(
    panel: ExplainPanel, listed: EventsPanel, run: CurrentRun
) -> None:
    lesson: Any = SimpleNamespace(covers=True)
    covered = replace(at(run, 30, lesson=lesson).displayed, steps=(), errors_m={}, statuses={})  # type: ignore[type-var]
    state = replace(at(run, 30, lesson=lesson), displayed=covered)
    panel.show(state)
    listed.show(state)
    assert frames(listed._events.content) == [] and 'class="headline"' not in panel._verdicts.content


def test_the_button_runs_to_the_next_anomaly(panel: ExplainPanel) -> None:
    button: Any = panel._next
    for callback in button._impl.update_cb:
        callback(SimpleNamespace(target=button, client=None, client_id=None))
    assert panel._session.asked == [StepToEvent(alarming=True)]  # type: ignore[attr-defined]


def test_a_warning_of_an_earlier_frame_that_still_holds_stays_visible() -> None:
    bad, log, row = (
        Step(0, Status.TRACKING, decisions=(checks.SCALE_DRIFT.of(51, 10),), method="monocular"),
        EventLog(),
        NO_ROW,
    )
    for frame, step in enumerate(
        (bad, replace(bad, decisions=()), replace(bad, decisions=(checks.SCALE_DRIFT.of(5, 10),)))
    ):
        before, row = row, row_after(row, frame, frame, (step,), {})
        log.add(frame, frame, (step,), before, row)
    run: Any = SimpleNamespace(events=log)
    assert [list(ongoing(run, frame)) for frame in (0, 1, 2)] == [[], ["monocular"], []]
