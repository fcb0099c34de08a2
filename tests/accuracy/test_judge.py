"""The study of the judge: what it plants, and how it counts."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from ispom.geometry import so3_exp
from ispom.types import Trajectory
from tests.accuracy import studies
from tests.accuracy.__main__ import main
from tests.accuracy.judge import SIMULATED, Found, plants, recordings_in
from tests.accuracy.page import marks

FOUND = [
    Found("sim:a", "", "", True, False, "agrees"),
    Found("sim:a", "clock", "10 ms", True, True, "contradicted", ("clock",)),
    Found("real", "", "", False, True, "contradicted", ("motion at 0 to 9",)),
    Found("real", "clock", "10 ms", False, True, "contradicted", ("turning",), True),
    Found("still", "", "", True, False, "cannot tell"),
    Found("still", "clock", "10 ms", False, False, "cannot tell"),
]


def test_seven_kinds_are_planted_and_each_changes_the_poses() -> None:
    times = np.arange(60, dtype=np.int64) * 33_333_333
    s = times[:, None] * 1e-9
    turns = so3_exp(np.concatenate([0.1 * np.sin(7 * s), 0.2 * s, 0.05 * np.cos(9 * s)], axis=1))
    truth = Trajectory(times, turns, np.concatenate([s, np.sin(3 * s), s**2], axis=1))
    kinds = set()
    for plant in plants(truth, 60):
        wrong = plant.applied(truth)
        kinds.add(plant.kind.partition(" of the ")[0] if plant.kind.startswith("drift") else plant.kind)
        same = (np.allclose(getattr(truth, n), getattr(wrong, n)) for n in ("times_ns", "rotations", "translations"))
        assert not all(same), plant
    assert kinds == {"drift", "jump", "smoothing", "clock", "axes", "step of the scale", "mount"}


def test_recordings_without_files_are_left_out(tmp_path: Path) -> None:
    assert tuple(recordings_in(tmp_path)) == SIMULATED


def test_the_table_counts_by_kind_and_size(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(studies, "found", lambda module, task: [asdict(f) for f in FOUND])
    page, (begin, end) = tmp_path / "page.md", marks("judge")
    page.write_text(f"{begin}\nold\n{end}\n")
    assert main(["judge", "--data", str(tmp_path), "--only", SIMULATED[0], "--table", str(page)]) == 0
    text = page.read_text()
    assert "| clock | 10 ms | 1 of 1 | 1 of 1 | 0 of 1 | 1 of 1 | 1 |" in text and "old" not in text
    assert "alarm: 1 of 3" in text and "still" in text
