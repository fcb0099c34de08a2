"""steps.csv and decisions.csv: one row for each thing that was said, whole even where the run was not."""

from __future__ import annotations

import csv
from io import FileIO
from pathlib import Path

import pytest
from ispom_app.engine.history.step_quantities.step import DROPPED
from ispom_app.engine.playback import Playback
from ispom_app.engine.run_folder import run_folder, step_log, table
from ispom_app.engine.run_folder.run_folder import RunFolder
from ispom_app.engine.run_folder.step_reader import stored_steps

from ispom.errors import InputError
from ispom.io.whole import create_file
from ispom.types import TrackStatus
from tests import doubles
from tests.app import helpers


@pytest.fixture
def playback() -> Playback:
    return Playback(doubles.sequence(8), ("monocular", "stereo"), builder=helpers.build)


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_one_row_per_method_and_exposure(playback: Playback, tmp_path: Path) -> None:
    folder, events = RunFolder(tmp_path), []
    with step_log.StepLog(folder) as log:
        while not playback.done:
            events.append(playback.step())
            log.add(events[-1])
        assert not (tmp_path / run_folder.STEPS).exists(), "a file that still grows must not look finished"
    found, decisions = rows(tmp_path / run_folder.STEPS), rows(tmp_path / run_folder.DECISIONS)
    assert len(found) == len(events) == len(decisions)
    for event, row in zip(events, found, strict=True):
        (step,) = event.steps
        (tracks,) = step.tracks.values()
        assert int(row["time_ns"]) == step.time_ns and row["method"] == step.method
        assert int(row["exposure"]) == event.index and int(row["inliers"]) == len(step.residuals_px)
        assert int(row["dropped_epipolar"]) == int((tracks.status == TrackStatus.EPIPOLAR).sum())
        counted = sum(int(row[name]) for name in ("alive", "new", *DROPPED))
        assert counted == len(tracks)
        assert float(row["seconds"]) == pytest.approx(0.005) and row["stages"] == "track=0.004;pose=0.001"
    assert decisions[0]["name"] == "parallax" and float(decisions[0]["value"]) == 14.2 and decisions[0]["passed"] == "0"


def test_a_full_disk_ends_the_table_and_not_the_run(
    playback: Playback, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def create(path: Path) -> FileIO:
        return FileIO("/dev/full", "wb") if path.name.endswith(run_folder.STEPS) else create_file(path)

    monkeypatch.setattr(table, "create_file", create)
    folder = RunFolder(tmp_path)
    with step_log.StepLog(folder) as log:
        while not playback.done:
            log.add(playback.step())
    assert folder.problem is not None and "steps.csv cannot be written" in folder.problem
    assert len(rows(tmp_path / run_folder.DECISIONS)) == len(playback.sequence)


@pytest.mark.parametrize("name", [run_folder.STEPS, run_folder.DECISIONS])
def test_a_file_without_line_ends_is_refused_before_all_of_it_is_read(
    playback: Playback, tmp_path: Path, name: str
) -> None:
    with step_log.StepLog(RunFolder(tmp_path)) as log:
        log.add(playback.step())
    with (tmp_path / name).open("r+b") as file:
        file.truncate(1 << 40)
    with pytest.raises(InputError), stored_steps(tmp_path) as steps:
        list(steps)
