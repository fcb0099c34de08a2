"""What is known of a sweep, as its process tells it."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import pytest
from ispom_app.engine.options import SourceOptions
from ispom_app.features.sweep.process import SweepProcess
from ispom_app.features.sweep.sweep import Sweep
from ispom_app.features.sweep.values import Swept
from ispom_app.presentation.texts import duration

from tests.app.helpers import wait_for

BEGUN = Sweep.begun("sweep-1", Swept("stereo", "max_tracks", (100, 200, 400, 800)), "sim:tiny", SourceOptions(), 50.0)
ECHO = """
import json, sys
task = json.loads(sys.stdin.readline())
print(json.dumps({"row": 0, "folder": task["out"], "failure": None, "values": {"ate_m": 1.0}, "ms": 2.0}), flush=True)
print("no json", flush=True)
"""


def row(place: int, **changes: Any) -> dict[str, Any]:
    given = {"row": place, "folder": "runs/a", "failure": None, "values": {"ate_m": 0.1}, "ms": 5.0}
    return given | changes


def test_the_share_and_the_time_left_follow_the_exposures() -> None:
    half = BEGUN.after({"at": [0, 30, 60]}, 60.0)
    assert half.share == pytest.approx(0.125) and half.left_s == pytest.approx(70.0)
    one = half.after(row(0), 70.0)
    assert one.share == 0.25 and one.left_s == pytest.approx(60.0) and not one.under_way
    assert one.outcomes[0].value == 100 and one.outcomes[0].values == {"ate_m": 0.1}
    parallel = one.after({"at": [2, 1, 2]}, 80.0).after({"at": [1, 1, 2]}, 80.0)
    assert parallel.share == 0.5, "runs at the same time"


def test_too_soon_no_remaining_time_is_reported() -> None:
    assert BEGUN.after({"at": [0, 1, 60]}, 50.2).left_s is None


@pytest.mark.parametrize("told", [{}, {"at": ["a", 1, 2]}, {"row": "x"}, {"unknown": 1}])
def test_what_it_does_not_know_changes_nothing(told: dict[str, Any]) -> None:
    assert BEGUN.after(told, 60.0) is BEGUN


def test_a_duration_is_read_as_people_say_it() -> None:
    assert [duration(s) for s in (0.4, 59.4, 60, 200)] == ["0 s", "59 s", "1 min 0 s", "3 min 20 s"]


def test_a_process_reports_and_ends(tmp_path: Path) -> None:
    process = SweepProcess("plan", tmp_path, 0, (sys.executable, "-c", ECHO))
    wait_for(lambda: not process.running, "its end")
    assert [told["folder"] for told in process.take_messages()] == [str(tmp_path)]
    assert process.failure == "" and process.take_messages() == []
    process.stop()


def test_how_it_failed_is_reported(tmp_path: Path) -> None:
    process = SweepProcess("plan", tmp_path, 0, (sys.executable, "-c", "raise SystemExit('no such thing')"))
    wait_for(lambda: not process.running, "its end")
    assert process.failure is not None and "exit code 1 (no such thing)" in process.failure
    process.stop()


def test_cancelled_it_ends_by_the_end_of_its_input(tmp_path: Path) -> None:
    process = SweepProcess("plan", tmp_path, 0, (sys.executable, "-c", "import sys; sys.stdin.read()"))
    assert process.running
    process.cancel()
    wait_for(lambda: not process.running, "its end")
    process.stop()


def test_one_that_does_not_end_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ispom_app.features.sweep.process.ENDS_S", 0.2)
    process = SweepProcess("plan", tmp_path, 0, (sys.executable, "-c", "import time; time.sleep(60)"))
    process.cancel()
    began_s = time.monotonic()
    wait_for(lambda: not process.running, "its end")
    assert time.monotonic() - began_s < 10
