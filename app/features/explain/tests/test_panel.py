"""What the tab Explain shows: a verdict for each method, and the events."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
from ispom_app.engine.events import Bookmark
from ispom_app.engine.history.quantities import NO_ROW, row_after
from ispom_app.engine.playback import Playback
from ispom_app.engine.run_events.log import EventLog
from ispom_app.features.explain.view import events, explain, ongoing
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.state import Activity, State, reduce
from ispom_app.views.web.view_values import value_of, views

from ispom.estimators.modern.monocular import checks
from ispom.plausibility.doubt import Doubt
from ispom.types import Status, Step
from tests import doubles
from tests.alone import METHODS
from tests.app.helpers import build_full, run_to_end, with_values


@pytest.fixture(scope="module")
def run() -> CurrentRun:
    return run_to_end(Playback(doubles.sequence(40), METHODS, builder=build_full))


def at(run: CurrentRun, index: int, **values: Any) -> State:
    state = reduce(State("double:40"), run.opened)
    return with_values(state, displayed=run.history[index], computed=len(run.history), **values)


def test_there_is_a_verdict_for_each_method(run: CurrentRun) -> None:
    index = next(r.index for r in run.history if r.kind == "video" and r.index > 20)
    found = explain(at(run, index), run, index)
    assert [card.method for card in found.cards] == list(METHODS) and all(card.headline for card in found.cards)
    stereo = next(card for card in found.cards if card.method == "stereo")
    assert stereo.when.startswith("at frame") and stereo.details is None, "that of the pair before"
    assert (found.frame, found.kind) == (index, "video")


def test_before_the_first_frame_it_says_what_that_waits_for() -> None:
    state = replace(State("double:40"), playing=True, activity=Activity("Compiling: 40 %, about 20 s", 0.0))
    assert "Compiling: 40 %, about 20 s" in explain(state, None, -1).waiting
    assert explain(replace(state, activity=None), None, -1).waiting
    assert not explain(State("double:40"), None, -1).waiting


def test_every_event_is_listed_with_its_bookmarks(run: CurrentRun) -> None:
    lost = next(e for e in run.events.events if e.kind == "lost")
    found = events(at(run, lost.frame, bookmarks=(Bookmark(3, 3, "the bus"),)), run, lost.frame)
    assert [row.frame for row in found.rows] == sorted([3, *(e.frame for e in run.events.events)])
    assert any("the bus" in row.sentence for row in found.rows)
    assert next(row for row in found.rows if row.sentence == lost.sentence).alarming
    assert msgspec.to_builtins(found)["frame"] == lost.frame


def test_a_doubt_about_the_source_reaches_the_page_as_text(run: CurrentRun) -> None:
    doubt = Doubt("pair_unlike", "The right images are turned.")
    explained = next(view for view in views() if view.name == "explain")
    for view in (explained, next(view for view in views() if view.name == "answer")):
        json.dumps(value_of(view, at(run, 30, notes=(doubt,)), run))
    (found,) = value_of(explained, at(run, 30, notes=(doubt,)), run)["notes"]
    assert found == doubt and type(found) is str


def test_of_many_events_those_around_the_frame_are_listed(run: CurrentRun, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ispom_app.features.explain.view.AROUND", 1)
    found = events(at(run, 30), run, 30)
    total = len(run.events.events)
    assert len(found.rows) <= 3 and found.earlier and found.earlier + len(found.rows) + found.later == total
    here = [e.frame for e in run.events.events if e.frame >= 30][:1]
    assert set(here) <= {row.frame for row in found.rows}


def test_while_a_question_of_a_lesson_is_open_nothing_is_given_away(run: CurrentRun) -> None:
    lesson: Any = SimpleNamespace(covers=True, lesson=SimpleNamespace(title="A lesson"), phase="asking")
    state = at(run, 30, lesson=lesson)
    listed = {view.name: view for view in views()}
    assert not value_of(listed["explain"], state, run)["cards"]
    assert not value_of(listed["events"], state, run)["rows"]


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
