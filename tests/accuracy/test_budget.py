"""The study of the error budget: what it plants, and how it counts."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from tests.accuracy import studies
from tests.accuracy.__main__ import main
from tests.accuracy.budget import BEGIN, CASES, END, Found, planted

FOUND = [
    Found(0, "stereo", "calibration", "wrong-baseline", 0.1, 0.009, 0.008, 0.007, 0.0095),
    Found(0, "monocular", "calibration", "wrong-baseline", 0.1, 0.0, 0.001, 0.0005, 0.002),
    Found(1, "integrated", "clock", "clock", 0.1, 0.005, 0.008, 0.007, 0.009),
    Found(2, "integrated", "clock", "clock", 0.1, 0.005, None),
]


def test_exactly_one_cause_is_left_out_and_what_the_rig_states_stays() -> None:
    faults = {"calibration": "wrong-baseline:percent=3", "clock": "clock:late_s=0.02"}
    both, right, timed = planted(0, faults), planted(0, faults, "calibration"), planted(0, faults, "clock")
    assert both.rig.baseline_m == pytest.approx(1.03 * right.rig.baseline_m) and right.rig.pair_sigma is None
    assert np.array_equal(both.times_ns, right.times_ns) and not np.array_equal(both.times_ns, timed.times_ns)
    assert timed.rig.baseline_m == both.rig.baseline_m


def test_each_cause_that_can_be_planted_is_in_twenty_cases() -> None:
    causes = {cause for _, _, faults in CASES for cause in faults}
    assert len(CASES) == 20 and causes == {"calibration", "clock", "noise", "outliers", "initial map"}
    assert any(len(faults) > 1 for _, _, faults in CASES)


def test_the_table_counts_intervals_of_what_a_method_feels(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(studies, "found", lambda module, task: [asdict(f) for f in FOUND if f.case == task["case"]])
    page = tmp_path / "page.md"
    page.write_text(f"# Title\n\n{BEGIN}\nold\n{END}\n\nend\n")
    assert main(["budget", "--table", str(page)]) == 0
    text = page.read_text()
    assert "| calibration | 1 of 1 |" in text and "| clock | 0 of 1 |" in text and "| all | 1 of 2 |" in text
    assert text.count("- case") == 1 and "old" not in text and text.endswith("end\n")
    assert "| all | 1 of 2 |" in capsys.readouterr().out
