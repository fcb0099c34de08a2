from __future__ import annotations

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.evaluation.corrected_rig import corrected
from ispom.geometry import Pose
from ispom.simulation.cameras import simulated_rig
from ispom.solvers.right_camera import COLUMNS, PAIR, TERMS, by_column, by_row
from ispom.types import Corrections, LensCorrection, MountCorrection, PairCorrection

RIG = simulated_rig()
SURE = 1e-12
RAYS = np.column_stack([np.random.default_rng(0).uniform(-0.5, 0.5, (50, 2)), np.ones(50)])


def test_the_corrected_lens_sees_what_the_correction_says() -> None:
    f, k = 0.004, -0.02
    found = corrected(RIG, Corrections(lens=LensCorrection(f, k, SURE * np.eye(2))))
    stretch = 1 + f + k * (RAYS[:, :2] ** 2).sum(1, keepdims=True)
    wanted = RIG.camera("video").project(np.column_stack([RAYS[:, :2] * stretch, RAYS[:, 2]]))
    np.testing.assert_allclose(found.rig.camera("video").project(RAYS), wanted, atol=0.1)
    assert any(f.applied for f in found.findings) and found.rig.left == RIG.left


@pytest.mark.parametrize("term", [name for name in TERMS if name not in ("q1", "q2", "lag")])
def test_the_corrected_right_camera_sees_what_the_correction_says(term: str) -> None:
    pair, covariance = np.zeros(PAIR), SURE * np.eye(PAIR)
    pair[TERMS.index(term)] = 0.001
    found = corrected(RIG, Corrections(pair=PairCorrection.of(pair, covariance))).rig
    near = RAYS * np.random.default_rng(1).uniform(4, 50, (len(RAYS), 1))
    ideal = RIG.camera("right").normalise(RIG.camera("right").project(near))
    on_rig = RIG.rig_from_right.apply(near)
    in_right = (found.rig_from_right.inverse() @ RIG.rig_from_right).apply(near)
    seen = RIG.camera("right").normalise(found.camera("right").project(in_right))
    left = RIG.camera("left").normalise(found.camera("left").project(RIG.rig_from_left.inverse().apply(on_rig)))
    disparity, still = RIG.baseline_m / near[:, 2], np.zeros((len(near), 2))
    wanted = np.column_stack([by_column(ideal, disparity) @ pair[:COLUMNS], by_row(ideal, disparity, still) @ pair])
    wanted[:, 1] += left[:, 1] - near[:, 1] / near[:, 2]
    np.testing.assert_allclose(seen - ideal, wanted, atol=4e-6)
    assert np.abs(wanted).max() > 3e-5


def test_the_video_camera_is_turned_and_moved_as_it_was_found_to_be() -> None:
    change = np.array([0.01, -0.02, 0.005, 0.01, 0.0, -0.02, 0.003])
    found = corrected(RIG, Corrections(mount=MountCorrection.of(change, SURE * np.eye(7))))
    turn = RIG.rig_from_video.rotation.T @ found.rig.rig_from_video.rotation
    np.testing.assert_allclose(Pose(turn, np.zeros(3)).rotvec, change[:3], atol=1e-12)
    moved = found.rig.rig_from_video.translation - RIG.rig_from_video.translation
    np.testing.assert_allclose(moved, change[3:6], atol=1e-12)
    clock = found.findings[-1]
    assert not clock.applied and "+3 +-" in str(clock) and "(not applied)" in str(clock)


def test_what_chance_explains_changes_nothing_and_is_reported() -> None:
    said = Corrections(lens=LensCorrection(0.001, 0.0, np.eye(2)))
    found = corrected(RIG, said)
    assert found.rig.video == RIG.video and not any(f.applied for f in found.findings)
    assert [finding.what for finding in found.findings] == ["video focal length", "video radial distortion"]


def test_fixed_parameters_are_not_reported() -> None:
    covariance = np.diag([0.0] * 6 + [SURE])
    (clock,) = corrected(RIG, Corrections(mount=MountCorrection.of(np.zeros(7), covariance))).findings
    assert clock.what == "video clock late"


def test_a_run_without_corrections_is_refused_in_one_sentence() -> None:
    with pytest.raises(InputError, match="no method corrected"):
        corrected(RIG.changed(video=None), Corrections(pair=PairCorrection()))


def test_the_parameters_are_named_in_the_order_of_the_solver() -> None:
    names = [name.removesuffix("_rad").removesuffix("_s") for name in PairCorrection.names()]
    assert tuple(names) == TERMS
    values = np.arange(PAIR, dtype=float)
    assert PairCorrection.of(values).values.tolist() == values.tolist()
    with pytest.raises(ValueError, match="17 parameters"):
        PairCorrection.of(np.zeros(3))
