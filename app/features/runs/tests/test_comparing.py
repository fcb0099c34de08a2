"""Comparing two runs of the table, as the session does it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from ispom_app.engine.history.record import ExposureRecord
from ispom_app.engine.history.series import Series
from ispom_app.engine.options import SourceOptions
from ispom_app.features.branches.commands import Fork
from ispom_app.features.runs.commands import CompareRuns, OpenSource, ShowKept
from ispom_app.features.runs.compare import compared_run
from ispom_app.features.runs.live import kept_rows
from ispom_app.session import commands as do
from ispom_app.session.branches.branches import Branch
from ispom_app.session.branches.kept import MOST_KEPT, Kept, limited
from ispom_app.session.branches.service import BranchService
from ispom_app.session.branches.state import Branches
from ispom_app.session.session import Session

from ispom.geometry import Pose
from ispom.methods import Config
from ispom.types import Status, Step
from tests.alone import METHODS
from tests.app.helpers import started, wait_for


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    found = started(tmp_path, "", autoplay=False)
    yield found
    assert found.close(5.0)


def opened(session: Session) -> None:
    session.post(OpenSource(" double:20 "))
    wait_for(lambda: session.state.phase == "ready", "the source")


def test_a_session_without_a_source_waits_and_says_what_cannot_be_opened(session: Session) -> None:
    assert session.state.phase == "empty" and session.run is None
    session.post(OpenSource("  "))
    wait_for(lambda: session.state.notice_count == 1, "the sentence")
    session.post(OpenSource("double:none"))
    wait_for(lambda: session.state.notice_count == 2, "the next sentence")
    assert session.state.phase == "empty" and session.run is None
    opened(session)
    wait_for(lambda: session.state.playing or session.state.ended, "playing")


def test_a_run_that_stopped_at_the_fork_is_computed_as_far_as_the_fork_and_compared(session: Session) -> None:
    opened(session)
    session.post(do.Seek(5))
    wait_for(lambda: session.state.index == 5 and session.state.target is None, "the frame to fork at")
    session.post(Fork(METHODS, Config()))
    session.post(do.Seek(12))
    wait_for(lambda: session.state[Branches].shown == 1 and session.state.computed == 13, "the fork")
    session.post(CompareRuns("live:0", "live:1"))
    wait_for(lambda: (c := session.state[Branches].comparison) is not None and c.finished, "the comparison")
    comparison = session.state[Branches].comparison
    assert comparison is not None
    assert (comparison.shown, comparison.other, comparison.start, comparison.stop) == (0, 1, 6, 13)
    assert session.state[Branches].shown == 0 and session.state.computed >= 13


def keys(session: Session) -> list[str]:
    """Of the rows of what was closed."""
    kept = session.service(BranchService).kept
    return [row.key for row in kept_rows(kept, [], session.recordings_dir)]


def test_a_run_that_was_closed_stays_in_the_table_and_goes_on_where_it_was(session: Session) -> None:
    opened(session)
    session.post(do.Seek(12))
    wait_for(lambda: session.state.index == 12 and session.state.target is None, "frame 12")
    session.post(OpenSource("double:15"))
    wait_for(lambda: session.state.total < 20 and session.state.phase == "ready", "the other source")
    assert keys(session) == ["live:1.0"]
    session.post(ShowKept("live:1.0"))
    wait_for(lambda: session.state.source == "double:20" and session.state.phase == "ready", "the run again")
    wait_for(lambda: session.state.computed == 13 and session.state.index == 12, "its frames")
    assert [key.partition(".")[2] for key in keys(session)] == ["0"] and "live:1.0" not in keys(session)
    session.post(do.Seek(15))
    wait_for(lambda: session.state.index == 15 and session.state.computed == 16, "frames that it goes on with")


def test_a_run_that_was_closed_is_compared_with_the_one_that_is_open(session: Session) -> None:
    for _ in range(2):
        opened(session)
        session.post(do.Seek(6))
        wait_for(lambda: session.state.index == 6 and session.state.target is None, "frame 6")
        run = session.state.run
        session.post(OpenSource("double:20"))
        wait_for(lambda run=run: session.state.run > run and session.state.phase == "ready", "the same source")
    session.post(CompareRuns(keys(session)[0], "live:0"))
    wait_for(lambda: (c := session.state[Branches].comparison) is not None and c.finished, "the comparison")
    comparison = session.state[Branches].comparison
    assert comparison is not None and comparison.stop >= 7 and not comparison.first


def test_what_is_kept_no_more_is_no_run(session: Session) -> None:
    opened(session)
    session.post(ShowKept("live:5.0"))
    wait_for(lambda: session.state.notices, "the sentence")
    assert session.state.source == "double:20"


def test_the_oldest_make_room_and_the_newest_is_always_kept() -> None:
    def kept(number: int, runs: int) -> Kept:
        return Kept(number, "", "", SourceOptions(), (), dict.fromkeys(range(runs)))  # type: ignore[arg-type]

    assert [each.number for each in limited((kept(1, 1), kept(2, MOST_KEPT // 2), kept(3, MOST_KEPT // 2)))] == [2, 3]
    assert [each.number for each in limited((kept(1, 1), kept(2, MOST_KEPT + 1)))] == [2]


def test_a_run_that_is_gone_cannot_be_compared(session: Session) -> None:
    opened(session)
    session.post(CompareRuns("live:0", "live:7"))
    wait_for(lambda: session.state.notices, "the sentence")
    assert session.state[Branches].comparison is None


def test_only_poses_of_frames_that_were_localised_are_a_path() -> None:
    """During the initialisation a method has poses that do not move: no scale comes from those."""
    series = Series(("monocular",))
    for index, status in enumerate((Status.INITIALISING, Status.TRACKING, Status.LOST, Status.TRACKING)):
        step = Step(index, status, "video", Pose(), method="monocular")
        series.append(ExposureRecord(index, index, "video", (step,), {}, {}, {}))
    run = SimpleNamespace(
        series=series, opened=SimpleNamespace(methods=("monocular",)), events=SimpleNamespace(events=())
    )
    found = compared_run(cast(Any, run), Branch(0, "run")).methods["monocular"]
    assert found.path.frames.tolist() == [1, 3] and found.localised.tolist() == [False, True, False, True]
