"""The doctor in a session: it answers for the run that is shown, shows its progress, and can be cancelled."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from ispom_app.engine import warmup
from ispom_app.features.doctor.commands import CancelExamination, Examine, ForkWithRemedy
from ispom_app.features.doctor.service import CANCELLED
from ispom_app.features.doctor.state import Examined
from ispom_app.session.branches.state import Branches
from ispom_app.session.commands import Seek
from ispom_app.session.session import Session

from ispom.ensemble import build
from ispom.estimators.modern.monocular.estimator import ModernMonocularConfig
from ispom.methods import Config
from ispom.sequences import open_sequence
from tests.app.helpers import started, wait_for


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    found = started(
        tmp_path_factory.mktemp("doctor"), "sim:tiny?fault=darkness",
        opener=lambda source, _=None: open_sequence(source), builder=build, methods=("stereo",), autoplay=False,
    )  # fmt: skip
    wait_for(lambda: found.state.phase == "ready", "opening")
    yield found
    found.close(5.0)


def examined(session: Session) -> Examined:
    return session.state[Examined]


def test_a_frame_is_examined_and_the_cause_is_shown(session: Session) -> None:
    session.post(Examine(30))
    wait_for(lambda: examined(session).progress is not None, "the beginning")
    wait_for(lambda: examined(session).diagnosis or examined(session).problem, "the answer", 120.0)
    assert not examined(session).problem
    found = examined(session).diagnosis
    assert found is not None and found.causes[0].suspect.key == "darkness"
    stretch = examined(session).stretch
    assert stretch is not None and stretch.first < 30 < stretch.last


def test_an_examination_is_cancelled(session: Session) -> None:
    session.post(Examine(60))
    session.post(CancelExamination())
    wait_for(lambda: examined(session).problem == CANCELLED, "the end", 60.0)
    assert examined(session).diagnosis is None and examined(session).progress is None


def test_its_time_begins_when_the_estimators_are_compiled(monkeypatch: pytest.MonkeyPatch, session: Session) -> None:
    asked, over = list[tuple[str, ...]](), threading.Event()

    def ready(methods: tuple[str, ...], config: Config, wait_s: float = 0.0) -> bool:
        asked.append(tuple(methods))
        return over.wait(wait_s)

    monkeypatch.setattr(warmup, "ready", ready)
    session.post(Examine(30))
    wait_for(lambda: (now := examined(session).progress) and warmup.MESSAGE in now.doing, "the message")
    assert ("stereo",) in asked
    over.set()
    wait_for(lambda: (now := examined(session).progress) and warmup.MESSAGE not in now.doing, "the examination")
    session.post(CancelExamination())
    wait_for(lambda: examined(session).problem == CANCELLED, "the end", 60.0)


def test_a_frame_beyond_the_end_is_refused(session: Session) -> None:
    session.post(Examine(10_000))
    wait_for(lambda: session.state.notices and "--at" not in session.state.notices[-1].text, "the refusal")


def test_without_a_setting_that_helped_nothing_is_forked(session: Session) -> None:
    before = len(session.state.notices)
    session.post(ForkWithRemedy())
    wait_for(lambda: len(session.state.notices) > before, "the refusal")
    assert len(session.state[Branches].all) == 1


@pytest.mark.slow
def test_a_setting_that_helped_is_forked_with(tmp_path: Path) -> None:
    """In the page an examination has a minute; settings that differ from their defaults come first."""
    config = Config({"monocular": ModernMonocularConfig(max_tracks=50)})
    session = started(
        tmp_path, "sim:tiny", opener=lambda source, _=None: open_sequence(source), builder=build,
        methods=("monocular",), config=config, autoplay=False,
    )  # fmt: skip
    try:
        wait_for(lambda: session.state.phase == "ready", "opening")
        session.post(Seek(60))
        wait_for(lambda: session.state.index == 60, "the run", 120.0)
        session.post(Examine(50))
        wait_for(lambda: examined(session).diagnosis or examined(session).problem, "the answer", 300.0)
        found = examined(session).diagnosis
        assert found is not None and found.helped is not None and found.helped is found.set_back
        best = found.helped.best
        assert best is not None and best.trial.key == "monocular.max-tracks"
        session.post(ForkWithRemedy())
        wait_for(lambda: len(session.state[Branches].all) == 2, "the fork", 60.0)
        branch = session.state[Branches].all[1]
        assert (
            branch.at == found.helped.first + 1 and session.state.config.of("monocular").max_tracks == best.trial.value
        )
    finally:
        session.close(5.0)
