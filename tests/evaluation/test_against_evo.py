"""ATE and RPE equal evo's to 1e-6 on other programs' estimates (evo is GPL: imported in tests only)."""

from pathlib import Path

import numpy as np
import pytest
from evo.core import metrics, sync
from evo.core.trajectory import PosePath3D, PoseTrajectory3D
from evo.tools import file_interface

from ispom.evaluation.association import associate
from ispom.evaluation.ate import Alignment, aligned, ate_m
from ispom.evaluation.rpe import rpe
from ispom.io.kitti import read_poses
from ispom.io.tum import read_tum
from ispom.types import Trajectory

DATA = Path(__file__).parents[3] / "shared" / "data" / "trajectories"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="../shared/data/trajectories is absent")

TUM = [
    ("freiburg1_xyz-rgbdslam.txt", "freiburg1_xyz-groundtruth.txt"),
    ("fr2_desk_ORB.txt", "fr2_desk_groundtruth.txt"),
    ("fr2_desk_ORB_kf_mono.txt", "fr2_desk_groundtruth.txt"),
]
KITTI = ["KITTI_00_ORB.txt", "KITTI_00_SPTAM.txt"]
Pair = tuple[Trajectory, Trajectory, PosePath3D, PosePath3D]


def load(estimate: str, reference: str) -> Pair:
    """Associated trajectories of both programs."""
    if estimate in KITTI:
        ours = [
            Trajectory.of([(10**8 * i, pose) for i, pose in enumerate(read_poses(DATA / name))])
            for name in (estimate, reference)
        ]
        theirs = [file_interface.read_kitti_poses_file(DATA / name) for name in (estimate, reference)]
        return ours[0], ours[1], theirs[0], theirs[1]
    own = associate(read_tum(DATA / estimate), read_tum(DATA / reference))
    evo_estimate, evo_reference = (file_interface.read_tum_trajectory_file(DATA / n) for n in (estimate, reference))
    evo_reference, evo_estimate = sync.associate_trajectories(evo_reference, evo_estimate)
    assert isinstance(evo_estimate, PoseTrajectory3D)
    return *own, evo_estimate, evo_reference


@pytest.fixture(scope="module", params=[*TUM, *((name, "KITTI_00_gt.txt") for name in KITTI)], ids=lambda p: p[0])
def pair(request: pytest.FixtureRequest) -> Pair:
    return load(*request.param)


def evo_value(metric: metrics.APE | metrics.RPE, estimate: PosePath3D, reference: PosePath3D) -> float:
    metric.process_data((reference, estimate))
    return metric.get_statistic(metrics.StatisticsType.rmse)


def evo_aligned(estimate: PosePath3D, reference: PosePath3D, alignment: Alignment) -> PosePath3D:
    copy = PosePath3D(poses_se3=[np.array(p) for p in estimate.poses_se3])
    if alignment != "none":
        copy.align(reference, correct_scale=alignment == "sim3")
    return copy


@pytest.mark.parametrize("alignment", ["none", "se3", "sim3"])
def test_ate(pair: Pair, alignment: Alignment) -> None:
    estimate, reference, evo_estimate, evo_reference = pair
    theirs = evo_value(
        metrics.APE(metrics.PoseRelation.translation_part),
        evo_aligned(evo_estimate, evo_reference, alignment),
        evo_reference,
    )
    assert ate_m(aligned(estimate, reference, alignment), reference) == pytest.approx(theirs, abs=1e-6)


@pytest.mark.parametrize("alignment", ["se3", "sim3"])
@pytest.mark.parametrize("delta", [1, 10])
def test_rpe(pair: Pair, alignment: Alignment, delta: int) -> None:
    estimate, reference, evo_estimate, evo_reference = pair
    moved = evo_aligned(evo_estimate, evo_reference, alignment)
    relations = metrics.PoseRelation.translation_part, metrics.PoseRelation.rotation_angle_deg
    theirs = [
        evo_value(metrics.RPE(r, delta, metrics.Unit.frames, all_pairs=True), moved, evo_reference) for r in relations
    ]
    assert rpe(aligned(estimate, reference, alignment), reference, delta) == pytest.approx(theirs, abs=1e-6)
