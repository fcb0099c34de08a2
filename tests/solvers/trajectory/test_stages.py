"""The stages of a segment's fit: each takes away what it is for, and the last is what the estimator gave."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ispom.geometry import Pose, Similarity
from ispom.solvers.trajectory.interpolation import interpolate
from ispom.solvers.trajectory.segment import fit_segment
from ispom.solvers.trajectory.stages import stages
from ispom.types import SegmentFit, Trajectory

SPAN_NS = (120_000_000, 480_000_000)
KINDS = ["given", "bracketed", "scaled", "turned", "oriented"]


def path(t_s: float) -> Pose:
    return Pose.from_rotvec(np.array([0.1 * t_s, 0.3 * t_s, 0.0]), np.array([t_s, 0.2 * np.sin(5 * t_s), 2 * t_s]))


@pytest.fixture
def fit() -> SegmentFit:
    """A video that drifts: its unit is 0.4 m, its world another, and its end is bent away."""
    own = Similarity(1 / 0.4, Pose.from_rotvec(np.array([0.4, -0.3, 0.2]), np.array([5.0, 6, 7])))
    times = np.arange(0.1, 0.55, 1 / 30)
    bent = [Pose.from_rotvec(np.array([0.0, 0.02 * t, 0.05 * t]), np.array([0.1 * t * t, 0, 0])) for t in times]
    items = [(round(t * 1e9), own.apply_pose(path(t)) @ b) for t, b in zip(times, bent, strict=True)]
    video = Trajectory.of(items, "video")
    metric = Trajectory.of([(t, path(t * 1e-9)) for t in SPAN_NS], "video")
    return SegmentFit(SPAN_NS, video, interpolate(video, np.array(SPAN_NS), "bspline"), metric)


def fitted(fit: SegmentFit) -> tuple[SegmentFit, Trajectory]:
    inside = fit.video.select((fit.video.times_ns >= SPAN_NS[0]) & (fit.video.times_ns < SPAN_NS[1]))
    own, metric = fit.own_ends, fit.metric_ends
    found = fit_segment(inside, own.pose(0), own.pose(1), metric.pose(0), metric.pose(1), SPAN_NS, 0.02)
    assert found is not None
    return replace(fit, scale=found.scale, turn_rad=found.turn_rad, residual_rad=found.residual_rad), found.poses


def test_the_last_stage_is_what_the_segment_became(fit: SegmentFit) -> None:
    whole, poses = fitted(fit)
    found = stages(whole)
    assert [stage.kind for stage in found] == KINDS
    assert_allclose(found[-1].poses.translations, poses.translations, atol=1e-9)
    assert_allclose(found[-1].poses.rotations, poses.rotations, atol=1e-9)


def test_each_stage_takes_away_what_it_is_for(fit: SegmentFit) -> None:
    whole, _ = fitted(fit)
    given, bracketed, scaled, turned, oriented = stages(whole)
    goal = whole.metric_ends.translations[1] - whole.metric_ends.translations[0]
    lengths = [float(np.linalg.norm(np.diff(s.ends.translations, axis=0))) for s in (given, scaled)]
    assert lengths[0] * (whole.scale or 0) == pytest.approx(lengths[1]) == pytest.approx(np.linalg.norm(goal))
    assert given.gap_m == bracketed.gap_m > scaled.gap_m > turned.gap_m < 1e-9
    assert scaled.direction_rad == pytest.approx(whole.turn_rad) and turned.direction_rad < 1e-7
    assert turned.orientation_rad == pytest.approx(whole.residual_rad) and oriented.orientation_rad < 1e-7
    assert oriented.gap_m < 1e-9


def test_all_begin_at_the_stereo_pose(fit: SegmentFit) -> None:
    whole, _ = fitted(fit)
    for stage in stages(whole):
        assert_allclose(stage.ends.translations[0], whole.metric_ends.translations[0], atol=1e-9)
        assert_allclose(stage.ends.rotations[0], whole.metric_ends.rotations[0], atol=1e-9)


def test_the_bracket_has_poses_on_both_sides_of_both_ends(fit: SegmentFit) -> None:
    whole, _ = fitted(fit)
    times = stages(whole)[1].poses.times_ns
    assert times[0] < SPAN_NS[0] < times[1] and times[-1] > SPAN_NS[1]


def test_a_segment_without_length_stays_as_it_was_given(fit: SegmentFit) -> None:
    assert [stage.kind for stage in stages(fit)] == KINDS[:2]


def test_a_fit_whose_arrays_were_given_up_has_no_stage(fit: SegmentFit) -> None:
    assert stages(replace(fit, video=Trajectory.empty("video"))) == ()
