"""A sweep in the session: the same files as `ispom experiment` writes, and its runs as branches."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from ispom_app.cli.main import main
from ispom_app.engine.options import SourceOptions
from ispom_app.features.branches.commands import ShowBranch
from ispom_app.features.recording.state import Recordings
from ispom_app.features.runs.commands import CompareRuns
from ispom_app.features.sweep.commands import CancelSweep, RunSweep, ShowSwept
from ispom_app.features.sweep.service import SweepService
from ispom_app.features.sweep.sweep import Sweep, SweepState
from ispom_app.features.sweep.values import parsed
from ispom_app.session import commands as do
from ispom_app.session.branches.state import Branches
from ispom_app.session.session import Session
from ispom_app.session.state import State
from ispom_app.session.store import Store

from ispom.ensemble import build
from ispom.sequences import open_sequence
from tests.app.helpers import started, wait_for

OPTIONS = SourceOptions(max_exposures=24)
SAME = ("results.csv", "results.parquet", "summary.json")


def opener(source: str, options: SourceOptions = OPTIONS):
    return open_sequence(source, max_exposures=options.max_exposures, seed=options.seed)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    found = started(
        tmp_path_factory.mktemp("recordings"), "sim:tiny", opener=opener, builder=build, methods=("stereo",),
        autoplay=False, source_options=OPTIONS,
    )  # fmt: skip
    wait_for(lambda: found.state.phase == "ready", "opening")
    yield found
    found.close(5.0)


def refusal(session: Session, command: do.Command, words: str) -> None:
    session.post(command)
    wait_for(lambda: any(words in notice.text for notice in session.state.notices), words)


def test_what_cannot_be_swept_is_reported(session: Session) -> None:
    refusal(session, RunSweep("stereo", "max_tracks", "200"), "1 value: give 2 to 6")
    refusal(session, ShowSwept(0), "this value has no run")
    assert session.state[SweepState].sweep is None


def test_it_gives_the_files_that_experiment_gives(session: Session, tmp_path: Path) -> None:
    session.post(RunSweep("stereo", "max_tracks", "200, 400"))
    wait_for(lambda: session.state[SweepState].sweep is not None, "its begin")
    refusal(session, RunSweep("stereo", "max_tracks", "200, 400"), "a sweep runs already")
    wait_for(lambda: session.state[SweepState].sweep and session.state[SweepState].sweep.ended, "its end", 120.0)
    sweep = session.state[SweepState].sweep
    assert sweep is not None and sweep.problem == "" and sweep.share == 1.0
    assert [o.value for _, o in sorted(sweep.outcomes.items())] == [200, 400]
    for outcome in sweep.outcomes.values():
        assert outcome.failure is None and outcome.ms and outcome.values is not None
        assert outcome.values["located_percent"] == pytest.approx(200 / 3), "of the three pairs all but the first"
    folder, out = session.recordings_dir / sweep.name, tmp_path / "out"
    assert main(["experiment", str(folder / "sweep.yaml"), "--out", str(out), "--workers", "0"]) == 0
    for name in SAME:
        assert (folder / name).read_bytes() == (out / name).read_bytes(), name
    wait_for(lambda: len(session.state[Recordings].listed) == 2, "its runs in the list")


def test_a_value_is_shown_as_a_branch_of_the_run(session: Session) -> None:
    total = session.state.total
    session.post(do.Seek(total - 1))
    wait_for(lambda: session.state.ended, "the end", 60.0)
    session.post(ShowSwept(1))
    wait_for(lambda: session.state[Branches].shown == 1, "the branch")
    shown = session.state[Branches].all[1]
    assert shown.name == "max-tracks 400, sweep-1" and shown.computed == total
    session.post(CompareRuns("live:1", "live:0"))
    wait_for(
        lambda: session.state[Branches].comparison and session.state[Branches].comparison.finished, "the comparison"
    )
    comparison = session.state[Branches].comparison
    assert comparison is not None and comparison.differing_frames == 0, "the setting that the run has gives the run"
    session.post(ShowBranch(0))
    session.post(ShowSwept(1))
    wait_for(lambda: session.state[Branches].shown == 1, "the same branch again")
    assert len(session.state[Branches].all) == 2


def test_cancelled_it_keeps_what_was_computed(session: Session) -> None:
    session.post(RunSweep("stereo", "window", "4, 8, 12, 16"))
    wait_for(lambda: session.state[SweepState].sweep and session.state[SweepState].sweep.name == "sweep-2", "its begin")
    wait_for(
        lambda: session.state[SweepState].sweep and session.state[SweepState].sweep.outcomes, "the first run", 120.0
    )
    session.post(CancelSweep())
    wait_for(lambda: session.state[SweepState].sweep and session.state[SweepState].sweep.ended, "its end")
    sweep = session.state[SweepState].sweep
    assert sweep is not None and sweep.problem == "cancelled" and 1 <= len(sweep.outcomes) < 4
    assert (session.recordings_dir / sweep.name / "results.csv").exists()


class Ended:
    """A process that has told what it has."""

    running, failure = False, ""

    def __init__(self, rows: int) -> None:
        self.rows = rows

    def take_messages(self) -> list[dict]:
        return [{"row": i, "folder": str(i), "failure": None, "values": None, "ms": None} for i in range(self.rows)]

    def cancel(self) -> None: ...

    def stop(self) -> None: ...


@pytest.mark.parametrize(("rows", "problem"), [(1, "cancelled"), (2, "")])
def test_after_the_last_run_there_is_nothing_to_cancel(tmp_path: Path, rows: int, problem: str) -> None:
    store = Store(State("sim:tiny"))
    store.put(SweepState(Sweep.begun("sweep-1", parsed("stereo", "window", "4, 8"), "sim:tiny", OPTIONS, 0.0)))
    listed: list[bool] = []
    recordings = SimpleNamespace(show=lambda: listed.append(True))
    desk = SweepService(SimpleNamespace(store=store, recordings=tmp_path, service=lambda kind: recordings))  # type: ignore[arg-type]
    desk._process = Ended(rows)  # type: ignore[assignment]
    desk.cancel()
    desk.watch()
    assert listed and store.state[SweepState].sweep is not None
    assert store.state[SweepState].sweep.ended and store.state[SweepState].sweep.problem == problem


def test_another_source_is_not_compared_with_it(session: Session) -> None:
    session.post(do.Open("sim:tiny", SourceOptions(max_exposures=24, seed=1)))
    wait_for(lambda: session.state.source_options.seed == 1, "another seed", 60.0)
    refusal(session, ShowSwept(0), "the sweep is over sim:tiny as it was opened then")
