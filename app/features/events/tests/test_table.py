"""Events in a run's folder, on the terminal, and read again."""

from __future__ import annotations

from pathlib import Path

import pytest
from ispom_app.engine.playback import Playback
from ispom_app.engine.run_events.event import RunEvent
from ispom_app.engine.run_events.table import PRINTED, EventRecorder, event_lines, events_text, read_events
from ispom_app.engine.verdict import Severity
from ispom_app.session.current_run import CurrentRun

from ispom.errors import InputError
from tests import doubles
from tests.alone import METHODS
from tests.app.helpers import build_full

LOST = RunEvent("lost", "stereo", 12, 120, Severity.LOST, 'Lost: 9 matches, "12" needed.', 14)
MAP = RunEvent("map", "monocular", 7, 70, Severity.OK, "Map initialised: 214 points.")


def playback() -> Playback:
    return Playback(doubles.sequence(40), METHODS, builder=build_full)


def test_a_table_is_read_as_it_was_written(tmp_path: Path) -> None:
    (tmp_path / "events.csv").write_text(events_text([MAP, LOST]))
    assert read_events(tmp_path / "events.csv") == [MAP, LOST]


@pytest.mark.parametrize(("old", "new"), [("frame,", "index,"), ("\n7,", "\nseven,"), (",lost,lost,", ",lost,gone,")])
def test_a_table_that_is_not_as_written_is_refused_in_one_sentence(old: str, new: str, tmp_path: Path) -> None:
    (tmp_path / "events.csv").write_text(events_text([MAP, LOST]).replace(old, new, 1))
    with pytest.raises(InputError, match=r"events\.csv line \d"):
        read_events(tmp_path / "events.csv")


def test_the_terminal_shows_the_first_warnings_and_losses_in_words() -> None:
    assert event_lines([MAP, LOST], "events.csv") == [f"frame 12: Stereo: {LOST.sentence}"]
    lines = event_lines([LOST] * (PRINTED + 3), "events.csv")
    assert len(lines) == PRINTED + 1 and "3 more" in lines[-1] and "events.csv" in lines[-1]


def test_a_run_without_a_page_has_the_events_of_one_with_a_page() -> None:
    plain, shown = EventRecorder(), CurrentRun(playback(), 10**8)
    run = playback()
    while not run.done:
        plain.add(run.step())
        shown.step()
    assert plain.log.events == shown.events.events and len(shown.events) > 2
