"""`ispom budget`: what a planted clock is given, in a table, in a file with its schema, and to agents."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.engine.outputs import json_of
from ispom_app.features.budget.bench import Bench, changed
from ispom_app.features.budget.split import APART, STARTS, Repeated, later_starts, outlier_row
from ispom_app.features.budget.text import rows
from ispom_app.features.budget.written import BudgetFile, written

from ispom.ensemble import build
from ispom.evaluation.budget.budget import Budget, Cause, Share
from ispom.evaluation.doctor.hypothesis import Change
from ispom.evaluation.sensitivity.perturbation import Perturbation
from ispom.evaluation.trajectory_error import TrajectoryError
from ispom.methods import Config
from ispom.sequences import open_sequence
from tests import doubles
from tests.app.helpers import ran
from tests.app.written import breaks_schema

FOUND = Budget(
    "stereo", "se3", 0.1, 50,
    (
        Cause("clock", "run again", Share.around(0.001, 0.0005)),
        Cause("calibration", "run again", Share.around(0.008, 0.001)),
        Cause("outliers", "run again", unknown="the method cannot leave out tracks"),
    ),
)  # fmt: skip
_TRUE = doubles.sequence(30).truth
assert _TRUE is not None
ERROR = TrajectoryError(_TRUE, _TRUE, "se3")


def test_shares_and_rest_add_up() -> None:
    assert not breaks_schema("budget", json_of(written([FOUND])))
    (method,) = written([FOUND]).methods
    known = [cause.share.m2 for cause in method.causes if cause.share is not None]
    assert sum(known) + method.rest.m2 == pytest.approx(method.ate_m**2)
    assert [cause.name for cause in method.causes if cause.share is None and cause.cannot_tell] == ["outliers"]


def test_the_largest_share_is_first_and_the_rest_last() -> None:
    assert [row[:3] for row in rows(FOUND)] == [
        ("calibration", "80 %", "70 to 90 %"),
        ("clock", "10 %", "5 to 15 %"),
        ("outliers", "cannot tell", ""),
        ("rest", "10 %", "-1 to 21 %"),
    ]


def test_later_starts_are_of_different_frames_of_each_method() -> None:
    sequence = doubles.sequence(60)
    starts = later_starts(sequence, 3)
    assert len(starts) == STARTS and sorted(set(starts)) == starts and starts[0] > 3
    assert {sequence.kinds[start] for start in starts} == {"stereo"}
    assert later_starts(sequence, len(sequence)) == [] and APART > STARTS


def test_reruns_that_were_not_made_or_have_no_path_say_nothing() -> None:
    run = Repeated((), ({"stereo": ERROR}, {"stereo": ERROR}), 0)
    same = ({"stereo": ERROR}, {"stereo": ERROR})
    assert run.share("stereo", ()) is None and run.share("stereo", ({}, same[1])) is None
    assert run.share("stereo", (same[0], {})) is None and run.share("stereo", same) == Share.around(0.0, 0.0)


def test_a_run_without_truth_or_of_another_method_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    ran("sim:tiny?duration_s=1", out, "--methods", "stereo", "--no-recording")
    assert main(["budget", str(out), "--methods", "monocular"]) == 2
    assert "no method 'monocular'" in capsys.readouterr().err


def test_a_rerun_with_nothing_changed_is_the_run_and_one_held_to_the_truth_is_as_good() -> None:
    sequence = open_sequence("sim:tiny?duration_s=1")
    bench = Bench(sequence, ("monocular",), Config(), build, lambda: None)
    begun, first = bench.begun()
    again = bench.errors(sequence)["monocular"]
    assert np.array_equal(again.estimate.translations, begun["monocular"].estimate.translations)
    assert 0 < first < 20
    assert bench.leave_out() == {"monocular"}
    assert bench.without_contradicted(sequence)["monocular"].ate_m < 2 * again.ate_m


def test_a_right_camera_that_turned_is_turned_back_and_the_stated_accuracy_stays() -> None:
    """The rig of a pair says nothing of turns: methods take its images to be rectified."""
    right = open_sequence("sim:tiny?duration_s=1")
    turned = open_sequence("sim:tiny?duration_s=1&fault=wrong-pair:yaw_deg=1,pitch_deg=0.5")
    back = changed(turned, Change(right_x_deg=0.5, right_y_deg=1.0))
    at = next(i for i, kind in enumerate(right.kinds) if kind == "stereo")
    images = [np.asarray(s.load(at).images["right"], float)[20:-20, 20:-20] for s in (right, turned, back)]  # type: ignore[union-attr]
    assert np.abs(images[2] - images[0]).mean() < 0.3 * np.abs(images[1] - images[0]).mean()
    assert back.rig.pair_sigma is turned.rig.pair_sigma and np.array_equal(back.times_ns, turned.times_ns)


def test_another_calibration_and_clock_keep_the_truth_of_each_frame() -> None:
    sequence = doubles.sequence(30)
    change = Change(Perturbation(baseline_percent=2.0, clock_ms=5.0))
    made = changed(sequence, change)
    assert made.rig.baseline_m == pytest.approx(1.02 * sequence.rig.baseline_m)
    assert sequence.truth is not None and made.truth is not None
    for time_ns, kind in zip(sequence.times_ns, sequence.kinds, strict=True):
        now = made.truth.at(int(time_ns) + 5_000_000 * (kind == "video"))
        was = sequence.truth.at(int(time_ns))
        assert now is not None and was is not None and np.allclose(now.translation, was.translation)


@pytest.mark.slow
def test_a_clock_has_nearly_all_of_the_error_that_it_makes(tmp_path: Path) -> None:
    run, out = tmp_path / "run", tmp_path / "budget"
    words = ["run", "sim:tiny?fault=clock:late_s=0.02", "--methods", "integrated", "--no-recording", "--out", str(run)]
    assert main(words) == 0
    assert main(["budget", str(run), "--repeats", "2", "--out", str(out)]) == 0
    found = msgspec.json.decode((out / "budget.json").read_bytes(), type=BudgetFile)
    (method,) = found.methods
    shares = {cause.name: cause.share for cause in method.causes}
    clock = shares["clock"]
    assert clock is not None and clock.percent > 80 and clock.low_m2 > 0
    assert not breaks_schema("budget", (out / "budget.json").read_text())


def test_where_no_track_was_left_out_nothing_is_known_of_outliers() -> None:
    nothing = outlier_row(Share.around(0.0, 0.0), True)
    assert nothing.share is None and nothing.unknown
    assert outlier_row(Share.around(0.0, 0.1), True).share is not None
    assert outlier_row(None, False).unknown != nothing.unknown
