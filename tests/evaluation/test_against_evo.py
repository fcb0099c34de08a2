"""ATE and RPE equal evo's to 1e-6 on other programs' estimates, with all of evo's alignments (evo is GPL: imported in
tests only)."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from evo.core import metrics, sync
from evo.core.trajectory import PosePath3D, PoseTrajectory3D
from evo.tools import file_interface

from ispom.evaluation.comparison import Comparison, Delta, compare, measures
from ispom.evaluation.relative_error import rpe
from ispom.evaluation.trajectory_error import Alignment, associate
from ispom.io.poses.recognised import read_trajectory
from ispom.types import Trajectory

DATA = Path(__file__).parents[3] / "shared" / "data" / "trajectories"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="../shared/data/trajectories is absent")

TUM = [
    ("freiburg1_xyz-rgbdslam.txt", "freiburg1_xyz-groundtruth.txt"),
    ("fr2_desk_ORB.txt", "fr2_desk_groundtruth.txt"),
    ("fr2_desk_ORB_kf_mono.txt", "fr2_desk_groundtruth.txt"),
]
EUROC = [("V102.txt", "V102_groundtruth.csv")]
KITTI = ["KITTI_00_ORB.txt", "KITTI_00_SPTAM.txt"]
Pair = tuple[Trajectory, Trajectory, PosePath3D, PosePath3D]
Both = tuple[Comparison, PosePath3D, PosePath3D]


@cache
def load(estimate: str, reference: str) -> Pair:
    """Associated trajectories of both programs."""
    ours = [read_trajectory(DATA / name).trajectory for name in (estimate, reference)]
    if estimate in KITTI:
        theirs = [file_interface.read_kitti_poses_file(DATA / name) for name in (estimate, reference)]
        return ours[0], ours[1], theirs[0], theirs[1]
    own = associate(*ours)
    read = file_interface.read_euroc_csv_trajectory, file_interface.read_tum_trajectory_file
    evo_estimate, evo_reference = (read[not n.endswith(".csv")](DATA / n) for n in (estimate, reference))
    evo_reference, evo_estimate = sync.associate_trajectories(evo_reference, evo_estimate)
    assert isinstance(evo_estimate, PoseTrajectory3D)
    return *own, evo_estimate, evo_reference


@pytest.fixture(
    scope="module", params=[*TUM, *EUROC, *((name, "KITTI_00_gt.txt") for name in KITTI)], ids=lambda p: p[0]
)
def pair(request: pytest.FixtureRequest) -> Pair:
    return load(*request.param)


def evo_value(metric: metrics.APE | metrics.RPE, estimate: PosePath3D, reference: PosePath3D) -> float:
    metric.process_data((reference, estimate))
    return metric.get_statistic(metrics.StatisticsType.rmse)


def evo_aligned(estimate: PosePath3D, reference: PosePath3D, alignment: Alignment) -> PosePath3D:
    copy = PosePath3D(poses_se3=[np.array(p) for p in estimate.poses_se3])
    if alignment == "first":
        copy.align_origin(reference)
    elif alignment != "none":
        copy.align(reference, correct_scale=alignment == "sim3", correct_only_scale=alignment == "scale")
    return copy


def thinned(pair: Pair) -> Pair:
    """Some 200 poses of each: evo takes seconds for thousands."""
    estimate, reference, *theirs = pair
    index = np.arange(0, len(estimate), max(1, len(estimate) // 200))
    copies = [PosePath3D(poses_se3=[np.array(path.poses_se3[i]) for i in index]) for path in theirs]
    return estimate.select(index), reference.select(index), copies[0], copies[1]


def test_the_same_poses_are_compared(pair: Pair) -> None:
    estimate, reference, evo_estimate, evo_reference = pair
    for ours, theirs in ((estimate, evo_estimate), (reference, evo_reference)):
        np.testing.assert_allclose(ours.translations, theirs.positions_xyz, rtol=0, atol=1e-12)
        np.testing.assert_allclose(ours.rotations, np.array(theirs.poses_se3)[:, :3, :3], rtol=0, atol=1e-12)


@pytest.fixture(scope="module", params=["none", "first", "scale", "se3", "sim3"])
def both(request: pytest.FixtureRequest, pair: Pair) -> Both:
    estimate, reference, evo_estimate, evo_reference = thinned(pair)
    ours = compare(estimate, reference, (estimate, reference), request.param)
    return ours, evo_aligned(evo_estimate, evo_reference, request.param), evo_reference


@pytest.mark.parametrize("relation", ["translation_part", "rotation_angle_deg"])
def test_ate(both: Both, relation: str) -> None:
    """Every pose's error, and all the statistics."""
    ours, moved, evo_reference = both
    errors = ours.position_errors if relation == "translation_part" else ours.rotation_errors_deg
    metric = metrics.APE(metrics.PoseRelation[relation])
    metric.process_data((evo_reference, moved))
    assert errors == pytest.approx(metric.error, abs=1e-6)
    unit, told = "m" if relation == "translation_part" else "deg", measures(ours)
    for name, value in metric.get_all_statistics().items():
        if name in ("rmse", "mean", "median", "max"):
            assert told[f"ate_{name}_{unit}"] == pytest.approx(value, abs=1e-6)


@pytest.mark.parametrize("delta", [1, 10])
def test_rpe(both: Both, delta: int) -> None:
    ours, moved, evo_reference = both
    relations = metrics.PoseRelation.translation_part, metrics.PoseRelation.rotation_angle_deg
    theirs = [
        evo_value(metrics.RPE(r, delta, metrics.Unit.frames, all_pairs=True), moved, evo_reference) for r in relations
    ]
    found = measures(replace(ours, delta=Delta(delta)))
    assert [found["rpe_rmse_m"], found["rpe_rmse_deg"]] == pytest.approx(theirs, abs=1e-6)
    assert rpe(ours.estimate, ours.reference, delta) == pytest.approx(theirs, abs=1e-6)
