"""With true poses, tracks give what is wrong with the calibration and the clock, within what they state."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.evaluation.budget.known_poses import CLOCK, Calibrated, calibrated
from ispom.evaluation.doctor.hypothesis import Change, change_of
from ispom.evaluation.doctor.stretch import Shot, Stretch
from ispom.evaluation.doctor.tracking import Tracked
from ispom.geometry import Array, Pose
from ispom.types import Camera, Rig, Trajectory
from tests.doubles import rig

VIDEO_NS = np.arange(31) * 33_000_000
PAIRS_NS = np.arange(6) * 170_000_000 + 40_000_000
POINTS = np.random.default_rng(5).uniform([-6, -4, 4], [6, 4, 25], (150, 3))


def true_pose(time_ns: int | np.signedinteger) -> Pose:
    t = int(time_ns) * 1e-9
    turn = np.array([0.15 * np.sin(3 * t), 0.3 * np.sin(2.5 * t), 0.1 * np.sin(4 * t)])
    return Pose.from_rotvec(turn, np.array([np.sin(2 * t), 0.4 * np.sin(3 * t), 1.5 * t]))


def seen_by(camera: Camera, world_from_camera: Pose) -> Array:
    uv = camera.project(world_from_camera.inverse().apply(POINTS))
    inside = (uv >= 0).all(axis=1) & (uv[:, 0] < camera.width) & (uv[:, 1] < camera.height)
    return np.where(inside[:, None], uv, np.nan)


def filmed(true: Rig, stated: Rig, late_ms: float, noise_px: float) -> tuple[Stretch, Tracked, Trajectory]:
    """The video is exposed so much after its stamps; the truth has the stamps of the frames."""
    late_ns = round(late_ms * 1e6)
    rng = np.random.default_rng(1)
    video = np.stack([seen_by(true.camera("video"), true_pose(t + late_ns) @ true.rig_from_video) for t in VIDEO_NS], 1)
    left, right = (
        np.stack([seen_by(true.camera(name), true_pose(t) @ true.rig_from(name)) for t in PAIRS_NS], 1)
        for name in ("left", "right")
    )
    shots = [Shot(i, int(t), {"video": np.zeros((1, 1), np.uint8)}) for i, t in enumerate(VIDEO_NS)]
    shots += [
        Shot(i, int(t), dict.fromkeys(("left", "right"), np.zeros((1, 1), np.uint8))) for i, t in enumerate(PAIRS_NS)
    ]
    stretch = Stretch(stated, tuple(sorted(shots, key=lambda shot: shot.time_ns)), VIDEO_NS)
    noisy = [uv + noise_px * rng.normal(size=uv.shape) for uv in (video, left, right)]
    truth = Trajectory.of([(int(t), true_pose(t + late_ns)) for t in VIDEO_NS])
    return stretch, Tracked(*noisy, survived=np.ones(len(VIDEO_NS) - 1)), truth


def wrong(**numbers: float) -> Change:
    return change_of(tuple(numbers), np.array(list(numbers.values())))


def found_for(change: Change, late_ms: float, noise_px: float) -> Calibrated:
    """`change` makes the true rig of the stated one."""
    found = calibrated(*filmed(change.of_rig(rig()), rig(), late_ms, noise_px))
    assert found is not None
    return found


def test_what_is_wrong_is_found_by_its_size_and_nothing_else() -> None:
    planted = {"video_focal_percent": 2.0, "baseline_percent": -3.0, CLOCK: 12.0}
    change = wrong(**{name: value for name, value in planted.items() if name != CLOCK})
    found = found_for(change, planted[CLOCK], 0.1)
    assert set(found.names) == set(planted)
    off = found.values - np.array([planted[name] for name in found.names])
    assert off @ np.linalg.solve(found.covariance, off) < 4 * len(off)


def test_nothing_is_wrong_with_a_right_calibration() -> None:
    assert found_for(wrong(), 0.0, 0.2).names == ()


def test_other_draws_are_the_same_for_a_seed() -> None:
    found = found_for(wrong(pair_focal_percent=1.5), -8.0, 0.2)
    assert set(found.names) == {"pair_focal_percent", CLOCK}
    drawn = found.drawn((CLOCK,), 1)
    assert drawn.perturbation.clock_ms == found.drawn((CLOCK,), 1).perturbation.clock_ms
    assert drawn.perturbation.clock_ms != found.change((CLOCK,)).perturbation.clock_ms
    assert drawn.perturbation.pair_focal_percent == 0
    assert found.change((CLOCK,)).perturbation.clock_ms == pytest.approx(-8.0, abs=1.0)


def test_without_true_poses_nothing_is_known() -> None:
    stretch, tracked, truth = filmed(rig(), rig(), 0.0, 0.0)
    assert calibrated(stretch, tracked, truth.select(slice(2))) is None
    few = Tracked(tracked.uv[:20], tracked.left[:20], tracked.right[:20], tracked.survived)
    assert calibrated(stretch, few, truth) is None
