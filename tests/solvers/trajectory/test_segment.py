"""Section 6.3 on exact trajectories: interpolation, and a segment that fits both of its ends."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.geometry import Pose, Similarity
from ispom.solvers.trajectory.interpolation import interpolate
from ispom.solvers.trajectory.segment import fit_rotations, fit_segment
from ispom.types import Trajectory


def path(t_s: float) -> Pose:
    return Pose.from_rotvec(
        np.array([0.05 * np.sin(9 * t_s), 0.3 * t_s, 0.04 * np.cos(7 * t_s)]),
        np.array([np.sin(t_s), 0.05 * np.sin(12 * t_s), 2 * t_s]),
    )


def sampled(times_s: np.ndarray) -> Trajectory:
    return Trajectory.of([(round(t * 1e9), path(round(t * 1e9) * 1e-9)) for t in times_s], "video")


def test_a_video_trajectory_in_any_unit_and_world_fits_exactly_where_it_is_exact() -> None:
    truth = sampled(np.linspace(0.1, 0.4, 10))
    own_from_world = Similarity(0.37, Pose.from_rotvec(np.array([0.4, -1.0, 0.3]), np.array([5.0, 2, 1])))
    own = Trajectory.of([(t, own_from_world.apply_pose(p)) for t, p in truth.items()], "video")
    start, end = path(0.1), path(0.4)
    ends = (own_from_world.apply_pose(start), own_from_world.apply_pose(end))
    segment = fit_segment(own, *ends, start, end, (100_000_000, 400_000_000), 0.02)
    assert segment is not None
    np.testing.assert_allclose(segment.poses.translations, truth.translations, atol=1e-9)
    np.testing.assert_allclose(segment.poses.rotations, truth.rotations, atol=1e-9)
    assert segment.scale == pytest.approx(1 / 0.37) and segment.residual_rad < 1e-6 and segment.turn_rad < 1e-6


def test_both_ends_are_met_whatever_the_video_drift() -> None:
    own = sampled(np.linspace(0.1, 0.4, 10))
    start = path(0.1) @ Pose.from_rotvec(np.array([0.02, 0, 0.01]), np.array([0.05, 0, 0]))
    end = path(0.4) @ Pose.from_rotvec(np.array([0, 0.05, 0]), np.array([0, 0.1, 0.1]))
    segment = fit_segment(own, path(0.1), path(0.4), start, end, (100_000_000, 400_000_000), 0.02)
    assert segment is not None
    for place, pose in ((0, start), (-1, end)):
        np.testing.assert_allclose(segment.poses.translations[place], pose.translation, atol=1e-9)
        np.testing.assert_allclose(segment.poses.rotations[place], pose.rotation, atol=1e-9)


def test_a_segment_without_length_has_no_ratio_but_still_orientations() -> None:
    own = sampled(np.linspace(0.1, 0.4, 10))
    ends = (path(0.1), path(0.4))
    assert fit_segment(own, *ends, path(0.1), path(0.1), (100_000_000, 400_000_000), 0.02) is None
    assert fit_segment(own, ends[0], ends[0], *ends, (100_000_000, 400_000_000), 0.02) is None
    rotations, residual = fit_rotations(own, *ends, path(0.1), path(0.1), (100_000_000, 400_000_000))
    np.testing.assert_allclose(rotations[-1], path(0.1).rotation, atol=1e-9)
    assert residual > 0.05


@pytest.mark.parametrize("kind", ["linear", "bspline"])
def test_interpolation_passes_through_its_poses_and_holds_its_ends(kind: str) -> None:
    known = sampled(np.linspace(0, 2, 9))
    same = interpolate(known, known.times_ns, kind)  # type: ignore[arg-type]
    np.testing.assert_allclose(same.translations, known.translations, atol=1e-9)
    np.testing.assert_allclose(same.rotations, known.rotations, atol=1e-9)
    outside = interpolate(known, np.array([-5, 10**11]), kind)  # type: ignore[arg-type]
    np.testing.assert_allclose(outside.translations, known.translations[[0, -1]], atol=1e-9)
    one = interpolate(known.select(np.array([0])), np.array([3, 4]), kind)  # type: ignore[arg-type]
    np.testing.assert_allclose(one.translations, known.translations[[0, 0]])
    with pytest.raises(ValueError, match="empty"):
        interpolate(Trajectory.empty(), np.array([1]), kind)  # type: ignore[arg-type]


def test_the_spline_is_smoother_than_the_line() -> None:
    known, between = sampled(np.arange(0, 2, 0.1)), np.arange(0.35, 1.6, 0.1)
    truth = sampled(between)
    errors = {
        kind: np.abs(interpolate(known, truth.times_ns, kind).translations - truth.translations).max()  # type: ignore[arg-type]
        for kind in ("linear", "bspline")
    }
    assert errors["bspline"] < 0.3 * errors["linear"]
