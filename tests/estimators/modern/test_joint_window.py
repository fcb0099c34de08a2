"""The window of the modern integration: pairs that are rare, time stamps that are wrong."""

from __future__ import annotations

import re

import numpy as np

from ispom.ensemble import build
from ispom.estimators.modern.integrated.estimator import ModernIntegratedConfig
from ispom.estimators.modern.integrated.state import ModernIntegratedState
from ispom.methods import Config
from ispom.types import Frame, Measurement, Sequence, Status, Step, Trajectory, is_stereo, is_video


def walked(
    flight: Sequence, exposures: list[Measurement], config: ModernIntegratedConfig
) -> tuple[ModernIntegratedState, list[Step], Trajectory]:
    ensemble = build(Config().with_settings("integrated", config), ("integrated",), flight.rig)
    state, steps = ensemble.start(), []
    for exposure in exposures:
        state, found = ensemble.step(state, exposure)
        steps += found
    return state["integrated"], steps, ensemble.finish(state)["integrated"]


def pairs_at(exposures: list[Measurement], wanted: set[int]) -> list[Measurement]:
    """The video, and of the pairs those of these numbers."""
    pairs = [e for e in exposures if is_stereo(e)]
    kept = [pairs[i] for i in wanted]
    return [e for e in exposures if is_video(e) or any(e is k for k in kept)]


def errors_m(found: Trajectory, flight: Sequence) -> np.ndarray:
    assert flight.truth is not None
    poses = [(p, q) for t, p in found.items() if (q := flight.truth.at(t)) is not None]
    placed = poses[0][1] @ poses[0][0].inverse()
    return np.array([np.linalg.norm((placed @ p).translation - q.translation) for p, q in poses])


def test_pairs_farther_apart_than_the_window_has_views_are_adjusted_together(
    flight: Sequence, exposures: list[Measurement]
) -> None:
    given = pairs_at(exposures, {0, 5})
    state, steps, found = walked(flight, given, ModernIntegratedConfig(max_views=40))
    pairs = [e.time_ns for e in given if is_stereo(e)]
    inside = [e.time_ns for e in given if is_video(e) and pairs[0] <= e.time_ns <= pairs[1]]
    assert len(inside) > 40 >= len(state.window.views)
    assert {"views", "joint_cost"} <= {d.key for s in steps for d in s.decisions}
    assert found.times_ns.tolist() == inside
    _, _, whole = walked(flight, given, ModernIntegratedConfig())
    assert errors_m(found, flight).max() < max(0.02, 1.5 * errors_m(whole, flight).max())


def test_where_pairs_end_the_window_and_its_points_stay_as_many(flight: Sequence, exposures: list[Measurement]) -> None:
    given = pairs_at(exposures, {0, 1})
    ensemble = build(
        Config().with_settings("integrated", ModernIntegratedConfig(max_views=40)), ("integrated",), flight.rig
    )
    state, points = ensemble.start(), []
    for exposure in given:
        state, _ = ensemble.step(state, exposure)
        window = state["integrated"].window
        assert len(window.views) <= 40
        seen = np.unique(np.concatenate([v.ids for v in window.views] or [np.zeros(0, np.int64)]))
        points.append(len(window.table.ids) - len(seen))
    assert max(points) == 0


def test_one_bad_time_stamp_makes_no_thousand_knots(flight: Sequence, exposures: list[Measurement]) -> None:
    frames = [i for i, e in enumerate(exposures) if is_video(e)]
    given = list(exposures)
    late, before = exposures[frames[25]], exposures[frames[25] - 1]
    assert is_video(late)
    given[frames[25]] = Frame.video(before.time_ns + 100_000, late.image)
    _, steps, _ = walked(flight, given, ModernIntegratedConfig())
    told = [d.consequence for s in steps for d in s.decisions if d.key == "joint_cost"]
    knots = [int(re.search(r"(\d+) knots", text)[1]) for text in told]  # type: ignore[index]
    assert knots and max(knots) < 100


def test_video_below_5_hz_has_a_pose_from_the_first_pair_on(flight: Sequence, exposures: list[Measurement]) -> None:
    frames = [e for e in exposures if is_video(e)][::7]
    assert frames[1].time_ns - frames[0].time_ns > 200_000_000
    given = [e for e in exposures if is_stereo(e) or any(e is f for f in frames)]
    first = next(i for i, e in enumerate(given) if is_stereo(e))
    _, steps, found = walked(flight, given, ModernIntegratedConfig())
    assert all(s.status is Status.TRACKING and s.world_from_frame is not None for s in steps[first:])
    last_ns = max(e.time_ns for e in given if is_stereo(e))
    inside = [f.time_ns for f in frames if given[first].time_ns <= f.time_ns <= last_ns]
    assert found.times_ns.tolist() == inside
