"""Runs on workers of this machine: the rows of a serial run, whatever happens to the workers."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
import yaml
from ispom_app.cli.main import main
from ispom_app.features.experiments import cluster
from ispom_app.features.experiments.cluster import ATTEMPTS
from ispom_app.features.experiments.execute import execute
from ispom_app.features.experiments.results import TIMES, by_plan
from ispom_app.features.experiments.row import Row

from ispom.child import Child
from ispom.errors import InputError
from tests.app.experiment import made


def rows(out: Path, task: Callable, count: int = 2, **changes):
    plan = made.plan(**({"seeds": (0, 1)} | changes))
    found = list(cluster.parallel(plan, list(plan.runs()), out, False, count, 1.0, None, task, Row))
    return by_plan(plan, found)


def test_every_run_is_one_row_and_a_worker_that_dies_is_replaced(tmp_path: Path) -> None:
    found = rows(tmp_path, made.killed_at_first, lines=made.LINES[:1])
    assert [(r.run.line.name, r.run.seed, r.failure) for r in found] == [("a", 0, None), ("a", 1, None)]


def test_a_run_that_always_kills_its_worker_is_a_row_that_says_so(tmp_path: Path) -> None:
    found = rows(tmp_path, made.always_killed, count=1, seeds=(0,))
    assert [r.failure is None for r in found] == [False, True]
    assert found[0].failure == f"its worker died {ATTEMPTS} times: the last one was ended by SIGKILL"


def test_a_run_that_takes_too_much_memory_is_a_row_that_says_so(tmp_path: Path) -> None:
    found = rows(tmp_path, made.greedy, count=1, seeds=(0,))
    assert found[0].failure == f"its worker died {ATTEMPTS} times: the last one took more than 1 GB"
    assert found[1].failure is None


def test_workers_that_do_not_start_end_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(cluster, "COMMAND", [sys.executable, "-c", "raise SystemExit('no such module')"])
    with pytest.raises(InputError, match=r"exit code 1 \(no such module\)"):
        rows(tmp_path, made.quick, count=1, seeds=(0,))


def test_a_worker_that_ends_before_its_task_arrives_counts_as_dead(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    class Ended(Child):
        def __init__(self, command: list[str], environment: Mapping[str, str] | None = None) -> None:
            super().__init__(command, environment)
            assert self.wait(60)

    monkeypatch.setattr(cluster, "Child", Ended)
    monkeypatch.setattr(cluster, "COMMAND", [sys.executable, "-c", "raise SystemExit('no such module')"])
    with pytest.raises(InputError, match="exit code 1"):
        rows(tmp_path, made.quick, count=1, seeds=(0,))


def test_nothing_listens_but_on_this_machine(tmp_path: Path) -> None:
    (row, _) = rows(tmp_path, made.listening, count=1, seeds=(0,))
    assert row.values == {"of_scheduler": 0, "of_worker": 0}


def test_there_are_no_pages_of_dask(tmp_path: Path) -> None:
    (row, _) = rows(tmp_path, made.pages, count=1, seeds=(0,))
    assert row.values == {"of_scheduler": 0, "of_worker": 0}


def test_no_cluster_at_an_address(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(cluster, "ANSWER_S", 0.5)
    plan = made.plan()
    with pytest.raises(InputError, match=r"--scheduler tcp://127\.0\.0\.1:9"):
        list(cluster.parallel(plan, list(plan.runs()), tmp_path, False, 1, 1.0, "tcp://127.0.0.1:9", execute, Row))


def test_without_dask_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(cluster, "installed", lambda: False)
    plan = made.plan()
    with pytest.raises(InputError, match="Dask: pip install"):
        list(cluster.parallel(plan, list(plan.runs()), tmp_path, False, 1, 1.0, None, execute, Row))


def test_results_are_those_of_a_serial_run(tmp_path: Path) -> None:
    lines = {"B": {"method": "monocular.paper"}, "C": {"method": "stereo.paper"}}
    file = tmp_path / "own.yaml"
    file.write_text(yaml.safe_dump({"title": "Own", "sources": ["sim:tiny"], "lines": lines, "max_exposures": 12}))
    for count in ("0", "1"):
        assert main(["experiment", str(file), "--out", str(tmp_path / count), "--workers", count]) == 0
    names = sorted(path.name for path in (tmp_path / "0").iterdir() if path.is_file() and path.name != TIMES)
    assert "results.csv" in names and "paths.svg" in names
    for name in names:
        assert (tmp_path / "0" / name).read_bytes() == (tmp_path / "1" / name).read_bytes(), name


def test_workers_leave_no_temporary_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Killed ones neither, and what a killed experiment left is removed by the next one."""
    scratch = tmp_path / "scratch"
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    (scratch / f"{cluster.SCRATCH}{gone.pid}-left" / "file").mkdir(parents=True)
    running = scratch / f"{cluster.SCRATCH}{os.getpid()}-other"
    running.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    rows(tmp_path / "out", made.killed_at_first, lines=made.LINES[:1], seeds=(0,), count=1)
    assert list(scratch.iterdir()) == [running]
