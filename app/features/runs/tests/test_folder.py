"""The recordings folder as rows: what `ispom run` wrote, and what somebody else put there."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
import yaml
from ispom_app.engine.run_folder.run_folder import METRICS, RUN
from ispom_app.features.headless.command import run
from ispom_app.features.headless.options import Run as Options
from ispom_app.features.runs.folder import RecordedRuns
from ispom_app.features.runs.table import Row

from tests.app import helpers


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run's folder."""
    folder = tmp_path_factory.mktemp("written") / "first"
    options = Options(source="sim:tiny", out=folder, recording=False, methods=("stereo",), max_exposures=45)
    assert run(options, helpers.build) == 0
    return folder


@pytest.fixture
def recordings(tmp_path: Path, written: Path) -> Path:
    shutil.copytree(written, tmp_path / "first")
    return tmp_path


def rows(folder: Path) -> dict[str, Row]:
    return {row.key: row for row in RecordedRuns(folder).rows()}


def test_a_finished_run_is_a_row_with_what_its_files_say(recordings: Path) -> None:
    (row,) = rows(recordings).values()
    assert (row.key, row.kind, row.name, row.recording) == ("first", "run", "first", "")
    assert row.source and row.when_s and row.picture.endswith(".jpg") and row.note == ""
    assert row.errors[0].method == "stereo" and row.located is not None and row.events is not None
    assert len(row.curves["stereo"]) > 2 and max(row.curves["stereo"]) >= row.errors[0].metres
    assert "max exposures 45" in row.differs


def test_a_run_is_read_again_when_it_has_changed(recordings: Path) -> None:
    found = RecordedRuns(recordings)
    assert found.rows()[0].errors
    (recordings / "first" / METRICS).write_text("{}")
    assert found.rows()[0].errors == ()


def test_a_fork_is_below_its_origin(recordings: Path) -> None:
    shutil.copytree(recordings / "first", recordings / "second")
    path = recordings / "second" / RUN
    plain = yaml.safe_load(path.read_text())
    plain["forked"] = [{"run": "/elsewhere/first", "at": 7, "methods": ["stereo"], "config": {}}]
    path.write_text(yaml.safe_dump(plain))
    row = rows(recordings)["second"]
    assert row.parent == "first" and "fork at frame 7" in row.name


def test_runs_of_a_sweep_are_members_of_one_row(recordings: Path) -> None:
    shutil.copytree(recordings / "first", recordings / "sweep-1" / "runs" / "line" / "tiny-seed-0")
    (recordings / "sweep-1" / "plan.yaml").write_text("title: '--stereo.max-tracks: 1, 2'\n")
    found = rows(recordings)
    assert found["sweep-1"].kind == "sweep" and found["sweep-1/runs/line/tiny-seed-0"].parent == "sweep-1"
    assert "max-tracks" in found["sweep-1"].name and found["sweep-1"].note is None


@pytest.mark.parametrize("content", ["", "[" * 100_000, '{"methods": 3}', "null"])
def test_damaged_metrics_cost_the_numbers_and_not_the_row(recordings: Path, content: str) -> None:
    (recordings / "first" / METRICS).write_text(content)
    (row,) = rows(recordings).values()
    assert row.key == "first" and row.errors == ()


def test_links_are_not_followed(recordings: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    outside = tmp_path_factory.mktemp("outside")
    shutil.move(recordings / "first", outside / "first")
    os.symlink(outside / "first", recordings / "linked")
    (recordings / "mine").mkdir()
    shutil.copy(outside / "first" / RUN, recordings / "mine" / RUN)
    os.symlink(outside / "first" / METRICS, recordings / "mine" / METRICS)
    found = rows(recordings)
    assert list(found) == ["mine"] and found["mine"].errors == ()
