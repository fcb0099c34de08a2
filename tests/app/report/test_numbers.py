"""What the report computes: errors, scale, and the decisions and moments that it picks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ispom_app.features.report import analysis, moments
from ispom_app.features.report.folder import Run
from ispom_app.features.report.steps import NUMBERS, DecisionRow, Steps
from ispom_app.features.report.traces import ALL_POINTS, MAX_POINTS, points_per_line, thinned

from ispom.geometry import Pose
from ispom.types import Decision, Rig, Trajectory
from tests import doubles

TIMES = np.arange(100) * 10**8


def run(estimate: Trajectory, method: str = "stereo", **others) -> Run:
    truth = Trajectory.of([(int(t), doubles.pose_at(int(t))) for t in TIMES])
    found = Run(Path("r"), "r", {}, {}, None, Rig(), {method: estimate}, truth, {}, (), {})
    return replace(found, **others)


def straight(turn_rad: float = 0.0) -> Trajectory:
    return Trajectory.of(
        [(int(t), Pose.from_rotvec(np.array([0, 0, turn_rad]), np.array([0, 0, 1e-9 * t]))) for t in TIMES]
    )


def test_a_moved_copy_of_the_truth_has_no_error() -> None:
    truth = run(Trajectory.empty()).truth
    assert truth is not None
    moved = truth.moved(left=Pose.from_rotvec(np.array([0.3, -1.0, 0.2]), np.array([4.0, 5.0, -6.0])))
    found = analysis.errors(run(moved), "stereo")
    assert found is not None and found.position_m.max() < 1e-9 and found.rotation_deg.max() < 1e-5
    assert analysis.plotted(run(moved), "stereo")[1] == "SE(3) to truth, 100 poses"


def test_orientation_on_a_straight_path_is_that_of_the_poses() -> None:
    """Positions alone say nothing about the turn about the path."""
    found = analysis.errors(run(straight(0.5), truth=straight()), "stereo")
    assert found is not None and found.rotation_deg.max() < 1e-5


def test_scale_over_time_of_a_shrinking_path() -> None:
    t = TIMES * 1e-9
    shrinking = Trajectory(TIMES, np.tile(np.eye(3), (100, 1, 1)), np.stack([0 * t, 0 * t, t - 0.03 * t**2], axis=1))
    found = analysis.step_scale(run(shrinking, truth=straight()), "stereo")
    assert found is not None
    middle_s = found[0] * 1e-9 - 0.5
    np.testing.assert_allclose(found[1], 1 - 0.06 * middle_s, atol=1e-9)
    relative = analysis.step_scale(run(shrinking, "monocular", truth=straight()), "monocular")
    assert relative is not None and relative[1][:10].mean() == pytest.approx(1, abs=1e-9)


def test_routine_tests_do_not_hide_what_mattered() -> None:
    triggers = [Decision("parallax", 1.0, 2.0, i % 5 == 0) for i in range(20)]
    trouble = [Decision("points", 3.0, 12.0, False, consequence="not located"), Decision("cost", 2.0, 1.0, False)]
    fine = [Decision("cost", 0.5, 1.0, True)] * 9
    rows = tuple(DecisionRow(i, i, "stereo", decision) for i, decision in enumerate([*triggers, *trouble, *fine]))
    assert [s.decision for s in analysis.notable(run(straight(), decisions=rows))] == trouble


def test_the_worst_moments_are_the_worst() -> None:
    status = tuple("lost" if i in (40, 41) else "tracking" for i in range(100))
    columns = {name: np.ones(100) for name in NUMBERS}
    columns["error_m"] = np.where(TIMES[70] == TIMES, 5.0, np.nan)
    columns["seconds"] = np.where(TIMES[40] == TIMES, 2.0, 1.0)
    steps = Steps(np.arange(100), TIMES, status, np.zeros(100, bool), columns, {})
    found = {moment.exposure: moment.why for moment in moments.worst(run(straight(), steps={"stereo": steps}))}
    assert found[40] == ("stereo: lost", "stereo: slowest, 2.00 s") and 41 not in found
    assert len(found[70]) == 1 and "stereo" in found[70][0] and "5.00 m" in found[70][0]


def test_a_long_line_keeps_its_peaks() -> None:
    values = np.zeros(100_000)
    values[54_321] = 7.0
    line = thinned(MAX_POINTS, "a", "#000000", np.arange(100_000.0), values)
    assert len(line["y"]) == MAX_POINTS and max(line["y"]) == 7.0


def test_a_page_of_many_runs_stays_small() -> None:
    assert points_per_line(1) == points_per_line(2) == MAX_POINTS
    assert all(runs * points_per_line(runs) <= ALL_POINTS for runs in range(2, 25))
