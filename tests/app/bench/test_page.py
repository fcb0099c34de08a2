"""`ispom bench --page`: whoever looks at a run, its estimates are the same; what is measured is whole. No time is
asserted."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.features.benchmark import studies
from ispom_app.features.benchmark.page.drive import to_and_fro
from ispom_app.features.benchmark.page.measure import ATTENDANCES, Attendance, answered, attended
from ispom_app.features.benchmark.page.served import Served
from ispom_app.features.benchmark.rounds import FRAME_NS, SCENARIOS, world_from_rig

from ispom.errors import InputError
from ispom.types import Trajectory
from tests import doubles
from tests.sequences.own_folders import write_sequence

EXPOSURES = 40


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three small cameras on a round trip."""
    made = next(s for s in SCENARIOS if len(s.kinds) == 2).sequence(EXPOSURES)
    times = np.unique(made.times_ns).tolist()
    truth = Trajectory.of([(t, world_from_rig(t // FRAME_NS)) for t in times])
    return write_sequence(tmp_path_factory.mktemp("flight"), replace(made, truth=truth))


@pytest.mark.parametrize("attendance", ATTENDANCES, ids=lambda a: a.name)
def test_whoever_looks_the_estimates_are_those_without_an_app(attendance: Attendance, flight: Path) -> None:
    methods = ("monocular.paper", "stereo")
    found = attended(Served(source=str(flight), exposures=EXPOSURES, methods=methods, headless=True), attendance)
    assert found["same"] and found["worker_ms"] > 0 and found["headless_ms"] > 0


def test_moves_in_a_run_and_its_branch_are_timed(flight: Path) -> None:
    served = Served(source=str(flight), exposures=EXPOSURES, methods=("stereo",), branch_at=30)
    found = answered(served, samples=3)
    assert found["moves"].keys() == {"step back", "seek", "show a branch"}
    for times in found["moves"].values():
        assert len(times["state_ms"]) == len(times["panels_ms"]) == 3
        assert all(0 < state <= panels for state, panels in zip(*times.values(), strict=True))
    assert 20 < found["one_run_mb"] < 10_000 and found["two_branches_mb"] > 20


def test_a_drive_goes_to_and_fro() -> None:
    drive = doubles.sequence(6)
    made = to_and_fro(drive, 20)
    assert len(made) == 20 and (np.diff(made.times_ns) >= 0).all()
    there, back = made[len(drive) - 2], made[len(drive)]
    assert type(there) is type(back) and there.time_ns < back.time_ns


def test_the_tables_are_printed_and_written(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def one(served: Served, attendance: Attendance) -> dict:
        slow = attendance.name == "10 pages"
        return {"who": attendance.name, "worker_ms": 13.0 if slow else 10.5, "headless_ms": 10.0, "same": not slow}

    def long(served: Served) -> dict:
        assert (served.exposures, served.branch_at, served.headless) == (500, 400, False)
        move = {"state_ms": [5.0, 7.0], "panels_ms": [40.0, 240.0]}
        return {"exposures": 500, "samples": 2, "moves": {"seek": move}, "one_run_mb": 300.0, "two_branches_mb": 320.4}

    monkeypatch.setattr(studies, "attended", one)
    monkeypatch.setattr(studies, "answered", long)
    written = tmp_path / "page.json"
    assert main(["bench", "--page", "--page-exposures", "500", "--json", str(written)]) == 0
    told = capsys.readouterr().out
    assert "1.30 !" in told and "differ !" in told and "6.0 ms" in told and "230.0 ms !" in told and "320 MB" in told
    assert json.loads(written.read_text())["page"]["answered"]["two_branches_mb"] == 320.4
    assert main(["bench", "--page", "--page-exposures", "5"]) == 2


def test_a_source_that_cannot_be_opened_is_no_endless_wait(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nowhere"):
        attended(Served(source=str(tmp_path / "nowhere"), exposures=EXPOSURES), ATTENDANCES[0])
