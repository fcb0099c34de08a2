"""The events on the page's time axis."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from ispom_app.engine.playback import Playback
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.state import State
from ispom_app.views.web.time_axis import AxisNews

from tests import doubles
from tests.alone import METHODS
from tests.app.helpers import build_full, with_values


def made() -> CurrentRun:
    return CurrentRun(Playback(doubles.sequence(40), METHODS, builder=build_full), 10**8)


def test_each_event_is_reported_once_and_a_page_that_comes_late_hears_the_same() -> None:
    run, early, parts, state = made(), AxisNews(), [], State("double:40")
    while not run.playback.done:
        run.step()
        parts += (early.since(state, run) or {}).get("events", [])
    late = (AxisNews().since(state, run) or {})["events"]
    assert parts == late and [e["at"] for e in late] == [e.frame for e in run.events.events]
    assert {e["severity"] for e in late} == {"lost", "ok"} and all(": " in e["text"] for e in late)
    assert early.since(state, run) is None


def test_an_open_question_of_a_lesson_covers_them() -> None:
    run, lesson = made(), SimpleNamespace(covers=True)
    while not run.playback.done:
        run.step()
    state: Any = with_values(State("double:40"), lesson=lesson)  # type: ignore[arg-type]
    assert "events" not in (AxisNews().since(state, run) or {})
