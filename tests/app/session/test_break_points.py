"""Break points in the session: run until a condition, and find it in what is computed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from ispom_app.expressions.evaluate import holds
from ispom_app.expressions.parser import parse
from ispom_app.run.history.quantities import quantities
from ispom_app.session import commands as do
from ispom_app.session.break_points import anomaly
from ispom_app.session.session import Session

from ispom.ensemble import Ensemble
from ispom.methods import Config
from ispom.types import Rig
from tests import doubles
from tests.alone import METHODS
from tests.app.helpers import started, wait_for

LOST = 'monocular.status == "lost"'


def build(config: Config, methods: tuple[str, ...], rig: Rig) -> Ensemble:
    """Estimators that are lost every so manieth time."""
    return doubles.ensemble(methods, doubles.FullEstimator)


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    session = started(tmp_path, "double:40", builder=build, autoplay=False)
    wait_for(lambda: session.state.phase == "ready", "opening")
    yield session
    assert session.close(5.0)


def asked(session: Session, command: do.Command) -> str:
    """The notice that it ends with."""
    count = session.state.notice_count
    session.post(command)
    wait_for(lambda: session.state.notice_count > count and session.state.target is None, "a notice")
    return session.state.notices[-1].text


def lost(session: Session) -> list[int]:
    return [r.index for r in session.history for s in r.steps if s.method == "monocular" and s.status == "lost"]


def test_it_runs_on_to_each_exposure_at_which_the_condition_holds(session: Session) -> None:
    told = asked(session, do.RunUntil(LOST))
    first = session.state.index
    assert lost(session) == [first] and session.state.computed == first + 1 and not session.state.playing
    assert told == f"stopped at exposure {first}: monocular.status lost"
    asked(session, do.RunUntil(LOST))
    assert lost(session) == [first, session.state.index] and session.state.index > first


def test_what_is_computed_already_is_not_computed_again(session: Session) -> None:
    asked(session, do.RunUntil(LOST))
    first, computed = session.state.index, session.state.computed
    session.post(do.Seek(0))
    wait_for(lambda: session.state.index == 0, "the start")
    asked(session, do.RunUntil(LOST))
    assert (session.state.index, session.state.computed) == (first, computed)


def test_next_and_previous_match(session: Session) -> None:
    session.post(do.Seek(40))
    wait_for(lambda: session.state.computed == 41, "exposure 40")
    found = lost(session)
    assert len(found) >= 2
    session.post(do.FindMatch(LOST, forwards=False))
    wait_for(lambda: session.state.index == found[-1], "the last one")
    session.post(do.FindMatch(LOST, forwards=False))
    wait_for(lambda: session.state.index == found[-2], "the one before")
    session.post(do.FindMatch(LOST))
    wait_for(lambda: session.state.index == found[-1], "the last one again")
    assert "holds at no computed exposure after" in asked(session, do.FindMatch(LOST))


def test_a_condition_that_never_holds_is_said_at_the_end(session: Session) -> None:
    assert "held at no exposure up to the end" in asked(session, do.RunUntil("stereo.error_m > 1e6"))
    assert session.state.ended
    assert "holds at no exposure after" in asked(session, do.RunUntil("stereo.error_m > 1e6"))


@pytest.mark.parametrize(
    ("condition", "sentence"),
    [("", "there is no condition"), ("stereo.sattus == 3", "column 1"), ("__import__('os')", "column 1")],
)
def test_a_mistake_is_a_sentence(session: Session, condition: str, sentence: str) -> None:
    assert sentence in asked(session, do.RunUntil(condition)) and session.state.computed == 0


def test_another_move_ends_the_search(session: Session) -> None:
    session.post(do.RunUntil("stereo.error_m > 1e6"))
    session.post(do.Seek(3))
    session.post(do.Seek(30))
    wait_for(lambda: session.state.index >= 30 and session.state.target is None, "exposure 30")
    assert session.state.until is None and not session.state.notices


def test_the_anomaly_is_a_condition_over_all_methods() -> None:
    expression = parse(anomaly(METHODS), quantities(METHODS))
    assert expression.methods == set(METHODS)


def test_a_jump_is_an_anomaly() -> None:
    expression = parse(anomaly(["stereo"]), quantities(["stereo"]))
    said = {"status": "tracking", "restarted": False, "moved_usual": 0.1}
    rows = [{"stereo": {**said, "moved": moved}} for moved in (None, 0.49, 0.51)]
    assert [holds(expression, row, rows[0]) for row in rows] == [False, False, True]


def test_a_fork_has_the_quantities_of_its_past(session: Session) -> None:
    session.post(do.Seek(30))
    wait_for(lambda: session.state.index == 30, "exposure 30")
    first = session.run
    assert first is not None
    session.post(do.Seek(20))
    wait_for(lambda: session.state.index == 20, "exposure 20")
    session.post(do.Fork(METHODS, Config()))
    wait_for(lambda: session.state.branch == 1 and session.state.computed == 44, "the fork")
    fork = session.run
    assert fork is not None and fork is not first
    for name in first.series.quantities:
        if not name.endswith(".seconds"):
            a, b = (run.series.values(name)[:31] for run in (first, fork))
            assert a.tobytes() == b.tobytes(), name
