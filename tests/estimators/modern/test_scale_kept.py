"""A segment has one unit: where that is lost, another segment begins, with a unit of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.estimators.modern.monocular.covariance import MapUncertainty
from ispom.estimators.modern.monocular.first_map import first_map
from ispom.estimators.modern.monocular.keyframe import (
    KEPT_WITHIN,
    MAX_SCALE_GROWTH,
    UNKNOWN_SCALE,
    begin_segment,
    check_scale,
    uncertainty_of,
)
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.setup import LOSS
from ispom.estimators.modern.monocular.state import Outcome, Start
from ispom.estimators.modern.monocular.tracks import TrackingResult
from ispom.estimators.modern.monocular.window import anchored_prior
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame
from ispom.geometry import Array, Pose
from ispom.numerics.robust import Noise
from ispom.types import Status

SIGMA = 1e-3
"""Of a track, normalised."""
NO_TRACKS = TrackingResult(np.zeros((0, 2), np.float32), np.zeros(0, np.uint8), np.zeros((0, 2), np.float32))


def uncertain(depth_sigma: float, scale_sigma: float = 0.0) -> MapUncertainty:
    no = np.zeros((0, 0))
    return MapUncertainty(
        (), np.zeros(0, np.int64), no, no, no, 1.0, np.eye(6), scale_sigma, 0.0, depth_sigma, depth_sigma
    )


def test_three_standard_deviations_of_a_kept_scale_are_the_promised_factor() -> None:
    assert np.exp(3 * MAX_SCALE_GROWTH) == pytest.approx(KEPT_WITHIN)


@pytest.mark.parametrize("window", [(0.01,), (0.01,) * 9, (0.02, 0.01, 0.05)])
def test_a_scale_that_was_known_must_not_become_uncertain(window: tuple[float, ...]) -> None:
    assert check_scale(window, uncertain(0.06)).passed
    assert not check_scale(window, uncertain(0.08)).passed


def test_a_scale_is_lost_in_the_first_keyframe_that_shows_it() -> None:
    assert not check_scale((0.01, 0.01, 0.01), uncertain(3.0)).passed


def test_a_window_that_is_bad_as_a_whole_has_no_scale() -> None:
    """Its smallest uncertainty is no measure of what a scale may become."""
    assert not check_scale((2.0, 3.0, 2.5), uncertain(2.0)).passed
    assert not check_scale((), uncertain(2.0)).passed


def test_the_scale_of_a_young_map_may_become_known_if_its_steps_have_lengths() -> None:
    assert check_scale((), uncertain(0.2)).passed and check_scale((0.2,), uncertain(0.25, 0.3)).passed
    assert not check_scale((0.2,), uncertain(0.25, 2 * UNKNOWN_SCALE)).passed


def test_a_camera_that_only_turns_before_known_points_keeps_its_scale() -> None:
    assert check_scale((0.01,), uncertain(0.01, scale_sigma=50.0)).passed


def flight(depths: Array, steps: Array, noise: float) -> Map:
    """The window of a camera that moves sideways over points at such depths, exact poses and points, noisy tracks."""
    rng, ids = np.random.default_rng(0), np.arange(len(depths))
    xyz = np.column_stack([rng.uniform(-0.5, 0.5, (len(depths), 2)), np.ones(len(depths))]) * depths[:, None]
    keys = []
    for i, x in enumerate(steps):
        near = xyz - (x, 0.0, 0.0)
        seen = near[:, :2] / near[:, 2:] + rng.normal(0, noise, (len(depths), 2))
        keys.append(TrackedFrame(i * 100_000_000, ids, seen, Pose(translation=np.array([x, 0.0, 0.0]))))
    prior = anchored_prior(tuple(k.pose for k in keys), np.zeros(2), np.zeros((6, 6)), 0.0)
    return Map(tuple(keys), ScenePoints(ids, xyz), prior, LOSS * SIGMA)


def begun(local_map: Map) -> Outcome:
    lost = check_scale((0.01,), uncertain(3.0))
    return begin_segment(Outcome(NO_TRACKS, Status.TRACKING, map=local_map, decisions=(lost,), segment=0), local_map)


def test_a_new_segment_has_a_unit_of_its_own_and_says_so() -> None:
    local_map = flight(np.random.default_rng(1).uniform(4, 8, 200), np.arange(8.0), SIGMA)
    loose = replace(local_map, prior=anchored_prior(local_map.poses, np.zeros(2), np.zeros((6, 6)), 3.0))
    assert uncertainty_of(loose).depth_sigma > 1
    outcome = begun(loose)
    assert outcome.restarted and outcome.segment is None and outcome.decisions[-1].consequence
    assert outcome.uncertainty is not None and outcome.uncertainty.depth_sigma < MAX_SCALE_GROWTH
    assert outcome.map is not None and outcome.map.poses[-1].translation == pytest.approx([7.0, 0.0, 0.0])


def test_keyframes_that_are_no_part_of_the_new_segment_are_final() -> None:
    """The camera hardly moved at first: the newer part of the window says more of the depths than the whole."""
    local_map = flight(np.random.default_rng(1).uniform(4, 8, 200), np.arange(8.0), SIGMA)
    outcome = begun(local_map)
    kept = {k.time_ns for k in outcome.map.keys} if outcome.map is not None else set()
    settled = {time_ns for time_ns, _ in outcome.settled}
    assert len(kept) >= 3 and kept.isdisjoint(settled)
    assert kept | settled == {k.time_ns for k in local_map.keys}


def sideways(start: Start, unit: float) -> tuple[Start, TrackedFrame]:
    """Frames of a sideways flight over a deep scene, whose first pose is the start's base."""
    rng = np.random.default_rng(0)
    xyz = rng.uniform((-2, -1.5, 3), (2, 1.5, 7), (200, 3))
    frames = []
    for i in range(8):
        near = xyz - (0.1 * i, 0.002 * i, 0)
        x = near[:, :2] / near[:, 2:] + rng.normal(0, 2e-4, (200, 2))
        frames.append(TrackedFrame(i * 100_000_000, np.arange(200), x))
    points = ScenePoints(start.points.ids, unit * xyz[start.points.ids])
    return replace(
        start, frames=(replace(frames[0], world_from_camera=start.base), *frames[1:]), points=points
    ), frames[-1]


def mapped(start: Start, unit: float = 1.0) -> tuple[Map, dict[str, float], dict[str, bool]]:
    start, last = sideways(start, unit)
    found, decisions = first_map(start, last, Noise(SIGMA / LOSS, LOSS), impatient=False)
    assert found is not None
    return found, {d.key: d.value for d in decisions}, {d.key: d.passed for d in decisions}


def some(count: int) -> ScenePoints:
    return ScenePoints(np.arange(count), np.zeros((count, 3)))


def test_a_map_after_a_loss_has_the_depth_of_the_scene_before_in_a_unit_that_is_its_own() -> None:
    found, _, passed = mapped(Start(depth=30.0))
    assert not passed["unit_points"] and "unit_factor" not in passed
    assert found.median_depth == pytest.approx(30.0)
    assert uncertainty_of(found).scale_sigma < 0.01


def test_a_map_before_nothing_has_its_baseline_as_the_unit() -> None:
    found, values, _ = mapped(Start())
    assert np.linalg.norm(found.poses[-1].translation) == pytest.approx(1.0, rel=1e-3) and "unit_points" not in values


def test_recognised_points_give_a_map_its_unit() -> None:
    found, _, passed = mapped(Start(depth=30.0, points=some(40)), unit=0.5)
    assert passed["unit_points"] and passed["unit_spread"]
    assert np.linalg.norm(found.poses[-1].translation) == pytest.approx(0.35, rel=0.03)


@pytest.mark.parametrize(("depth", "joined", "held"), [(None, True, 8), (30.0, True, 8), (30.0, False, 0)])
def test_no_position_is_held_where_the_camera_was_lost_in_motion(depth: float | None, joined: bool, held: int) -> None:
    start, _ = sideways(Start(depth=depth, joined=joined), 1.0)
    frames = tuple(replace(f, world_from_camera=Pose()) for f in start.frames)
    assert len(replace(start, frames=frames).held) == held


def test_a_segment_that_was_joined_keeps_the_scale_that_it_had_there() -> None:
    assert check_scale((0.2,), uncertain(0.205), joined=True).passed
    assert not check_scale((0.2,), uncertain(0.25), joined=True).passed
