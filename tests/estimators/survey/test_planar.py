"""Odometry in the plane: exact motions, and what it says of a motion that leaves the plane."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ispom.estimators.survey.planar import PlanarConfig, fit_planar_motion, planar_pose
from ispom.evaluation.trajectory_error import error_against_truth
from ispom.sequences.formats.simulated import open_simulated
from ispom.simulation.scenario.scenario import World
from tests.alone import alone, run

POINTS = np.random.default_rng(3).uniform([-8, -2, 4], [8, 2, 30], (60, 3))


@given(st.floats(-0.5, 0.5), st.floats(-2, 2), st.floats(-0.2, 0.2))
def test_a_motion_in_the_plane_is_found_exactly(x: float, z: float, angle: float) -> None:
    motion = np.array([x, z, angle])
    moved = planar_pose(motion).apply(POINTS)
    found, distances = fit_planar_motion(POINTS, moved[:, :2] / moved[:, 2:], np.zeros(3), 1e-3)
    assert_allclose(found, motion, atol=1e-6)
    assert distances.max() < 1e-6


def test_a_quarter_of_wrong_points_changes_nothing() -> None:
    motion = np.array([0.1, -1.0, 0.03])
    moved = planar_pose(motion).apply(POINTS)
    x = moved[:, :2] / moved[:, 2:]
    x[::4] += np.random.default_rng(1).normal(0, 0.2, x[::4].shape)
    found, distances = fit_planar_motion(POINTS, x, np.zeros(3), 1e-3)
    assert_allclose(found, motion, atol=1e-3)
    assert (distances[1::4] < 1e-3).all()


def test_the_path_stays_in_the_plane_and_a_new_segment_follows_a_loss(tmp_path) -> None:
    sequence = open_simulated("tiny", seed=0, cache_dir=tmp_path, duration_s=2.4)
    pairs = [sequence[i] for i, kind in enumerate(sequence.kinds) if kind == "stereo"]
    steps = list(run(alone("planar", sequence.rig, PlanarConfig()), pairs))
    heights, lost = [], False
    for step in steps:
        if step.world_from_frame is not None:
            rig_from_left = sequence.rig.rig_from_left
            heights.append((rig_from_left.inverse() @ step.world_from_frame @ rig_from_left).translation[1])
            assert step.restarted == lost
        lost = step.world_from_frame is None
    assert_allclose(heights, 0, atol=1e-9)


def test_a_level_drive_is_found_to_centimetres(tmp_path) -> None:
    sequence = open_simulated("tiny", 0, tmp_path, duration_s=2.4, world=World(motion="drive"))
    method = alone("planar", sequence.rig, PlanarConfig())
    state = method.start()
    for measurement in (sequence[i] for i, kind in enumerate(sequence.kinds) if kind == "stereo"):
        state, _ = method.step(state, measurement)
    found = method.finish(state)
    assert sequence.truth is not None
    error = error_against_truth(found, sequence.truth, sequence.rig, "se3")
    assert len(found) > 5 and error is not None and error.ate_m < 0.03
