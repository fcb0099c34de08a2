"""The judge on exact tracks of drawn points, without images: what is planted is found, and the truth is not denied."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ispom.evaluation.judge.evidence import Evidence, of_chunk
from ispom.evaluation.judge.judgement import Judgement, judge
from ispom.evaluation.judge.pairs import TwoViews
from ispom.evaluation.judge.poses import Change, changed, covered, drifted, turned
from ispom.evaluation.judge.shake import Smoothing
from ispom.evaluation.judge.tracks import Chunk
from ispom.geometry import Array, Pose, so3_exp
from ispom.types import Trajectory

FRAMES, PIXEL = 96, 1 / 500
TIMES_NS = np.arange(FRAMES, dtype=np.int64) * 33_333_333


def path(times_s: Array) -> Trajectory:
    """A camera that circles and sways in front of points about 4 m away."""
    t = times_s[:, None]
    position = np.concatenate([0.8 * np.sin(2.1 * t), 0.5 * np.cos(1.7 * t), 0.6 * np.sin(1.3 * t + 1)], axis=1)
    rotvec = np.concatenate([0.15 * np.sin(2.6 * t), 0.2 * np.sin(1.9 * t + 1), 0.15 * np.sin(3.1 * t)], axis=1)
    return Trajectory((times_s * 1e9).astype(np.int64), so3_exp(rotvec), position)


TRUTH = replace(path(TIMES_NS * 1e-9), times_ns=TIMES_NS)


def tracks(noise_px: float, truth: Trajectory) -> Chunk:
    """Points that all frames see, up to the border of the image."""
    rng = np.random.default_rng(4)
    points = rng.uniform([-4, -3, 3], [4, 3, 9], (220, 3))
    back = np.swapaxes(truth.rotations, 1, 2)
    xyz = np.einsum("fij,pfj->pfi", back, points[:, None] - truth.translations)
    x = xyz[..., :2] / xyz[..., 2:] + rng.normal(0, noise_px * PIXEL, (*xyz.shape[:2], 2))
    outside = (xyz[..., 2] < 0.5) | (np.abs(x) > [0.65, 0.5]).any(axis=2)
    return Chunk(0, FRAMES, np.where(outside[..., None], np.nan, x), PIXEL)


CHUNKS = {noise: tracks(noise, TRUTH) for noise in (0.0, 0.3)}


def judged(poses: Trajectory, noise_px: float = 0.3) -> Judgement:
    has_pose = covered(poses, TIMES_NS)
    evidence: Evidence = of_chunk(CHUNKS[noise_px], changed(poses, TIMES_NS, Change()), has_pose)
    return judge(evidence, poses, TIMES_NS, has_pose)


def witnessed(tracked: Trajectory, matched: Trajectory) -> Judgement:
    """TRUTH, judged by tracks and by matches that may show another motion."""
    chunk, other = tracks(0.3, tracked), tracks(0.3, matched)
    evidence = of_chunk(replace(chunk, matches=other.views), TRUTH, np.ones(FRAMES, bool))
    return judge(evidence, TRUTH, TIMES_NS, np.ones(FRAMES, bool))


def found(judgement: Judgement) -> dict[str, float]:
    return {each.kind: each.size for each in judgement.tested if each.accepted}


@pytest.mark.parametrize("noise_px", [0.0, 0.3])
def test_the_truth_agrees(noise_px: float) -> None:
    judgement = judged(TRUTH, noise_px)
    assert judgement.verdict == "agrees"
    assert not judgement.denied and not found(judgement)
    assert {each.kind for each in judgement.tested if not each.detectable} <= {"growing"}  # needs a longer recording


def test_another_world_and_unit_agree() -> None:
    moved = TRUTH.moved(left=Pose(turned(np.array([0.3, -1.0, 2.0])), np.array([5.0, 6.0, 7.0])))
    assert judged(replace(moved, translations=moved.translations * 0.2)).verdict == "agrees"


def test_half_a_trajectory_is_judged() -> None:
    half = TRUTH.select(slice(40, None))
    judgement = judged(half)
    assert judgement.verdict == "agrees" and judgement.frames == len(half)


@pytest.mark.parametrize("offset_s", [0.02, -0.1])
def test_a_clock_offset_is_measured(offset_s: float) -> None:
    late = replace(TRUTH, times_ns=TRUTH.times_ns + round(offset_s * 1e9))
    judgement = judged(late)
    assert judgement.verdict == "contradicted"
    assert set(found(judgement)) == {"clock"}
    assert found(judgement)["clock"] == pytest.approx(offset_s, abs=0.002)


def test_a_mount_is_measured() -> None:
    turn = np.radians([1.0, -1.5, 1.0])
    judgement = judged(TRUTH.moved(right=Pose(turned(turn), np.zeros(3))))
    assert set(found(judgement)) == {"mount"}
    assert found(judgement)["mount"] == pytest.approx(np.linalg.norm(turn), abs=np.radians(0.3))
    assert not judgement.denied


def test_a_lever_arm_is_measured() -> None:
    judgement = judged(TRUTH.moved(right=Pose(np.eye(3), np.array([0.3, 0.0, -0.4]))))
    assert set(found(judgement)) == {"lever"}
    assert found(judgement)["lever"] == pytest.approx(0.5, abs=0.05)


def test_exchanged_axes_are_named() -> None:
    body = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
    judgement = judged(TRUTH.moved(right=Pose(body, np.zeros(3))))
    assert set(found(judgement)) == {"axes"}
    assert judgement.change.mount is not None
    np.testing.assert_allclose(judgement.change.mount, body.T, atol=1e-9)
    assert not judgement.denied


def test_inverse_poses_are_named() -> None:
    back = np.swapaxes(TRUTH.rotations, 1, 2)
    inverse = replace(TRUTH, rotations=back, translations=-np.einsum("nij,nj->ni", back, TRUTH.translations))
    judgement = judged(inverse)
    assert set(found(judgement)) == {"inverse"} and judgement.change.inverse
    assert not judgement.denied


def test_a_jump_is_located() -> None:
    position = TRUTH.translations.copy()
    position[48:] += [0.3, 0.2, 0.0]
    judgement = judged(replace(TRUTH, translations=position))
    assert judgement.verdict == "contradicted" and not found(judgement)
    motion = [each for each in judgement.denied if each.kind == "motion"]
    assert len(motion) == 1 and motion[0].within is not None
    assert motion[0].within[0] <= 47 and motion[0].within[1] >= 48
    assert motion[0].within[1] - motion[0].within[0] <= 4


def test_a_step_of_the_scale_is_located() -> None:
    position = TRUTH.translations.copy()
    position[48:] = position[48] + 1.6 * (position[48:] - position[48])
    steps = [each for each in judged(replace(TRUTH, translations=position)).denied if each.kind == "scale"]
    assert len(steps) == 1
    assert steps[0].first < 48 < steps[0].last
    assert np.exp(steps[0].size) == pytest.approx(1.6, rel=0.15)


def test_frozen_poses_rest_while_the_images_move() -> None:
    rotations, position = TRUTH.rotations.copy(), TRUTH.translations.copy()
    rotations[40:60], position[40:60] = rotations[40], position[40]
    denied = judged(replace(TRUTH, rotations=rotations, translations=position)).denied
    rest = [each for each in denied if each.kind == "rest" and each.poses_rest]
    assert rest and rest[0].first >= 38 and rest[0].last <= 62


def test_too_few_frames_cannot_tell() -> None:
    assert judged(TRUTH.select(slice(0, 8))).verdict == "cannot tell"


def test_a_drift_of_the_turn_is_measured() -> None:
    judgement = judged(drifted(TRUTH, Change(turning=np.radians([0.0, 3.0, 0.0]))))
    assert set(found(judgement)) == {"turning"} and not judgement.denied
    assert found(judgement)["turning"] == pytest.approx(np.radians(3), rel=0.1)
    assert judgement.change.turning is not None
    np.testing.assert_allclose(judgement.change.turning, np.radians([0, -3, 0]), atol=np.radians(0.3))


def test_a_drift_of_the_scale_is_measured() -> None:
    judgement = judged(drifted(TRUTH, Change(growing=1.5)))
    assert found(judgement)["growing"] == pytest.approx(-1.5, rel=0.15)


def test_what_drifts_is_undone_by_the_opposite() -> None:
    change = Change(turning=np.array([0.1, -0.2, 0.3]), growing=0.2)
    there = drifted(TRUTH, change)
    back = drifted(there, Change(growing=-0.2))
    steps = [np.linalg.norm(np.diff(t.translations, axis=0), axis=1) for t in (TRUTH, back)]
    np.testing.assert_allclose(steps[0], steps[1], rtol=1e-9)
    turned_back = drifted(there, Change(turning=-np.array([0.1, -0.2, 0.3])))
    np.testing.assert_allclose(turned_back.rotations, TRUTH.rotations, atol=1e-9)


SHAKEN = replace(
    TRUTH, rotations=TRUTH.rotations @ so3_exp(np.random.default_rng(8).normal(0, np.radians(0.3), (FRAMES, 3)))
)
"""The path by hand."""


def lacked(poses: Trajectory) -> Smoothing:
    evidence = of_chunk(tracks(0.3, SHAKEN), poses, np.ones(FRAMES, bool))
    found = judge(evidence, poses, TIMES_NS, np.ones(FRAMES, bool)).smoothing
    assert found is not None
    return found


@pytest.mark.parametrize("window", [3, 9])
def test_smoothed_poses_lack_the_shake_of_the_images(window: int) -> None:
    near = [slice(max(0, k - window // 2), k + window // 2 + 1) for k in range(FRAMES)]
    rotations = [Rotation.from_matrix(SHAKEN.rotations[n]).mean().as_matrix() for n in near]
    positions = [SHAKEN.translations[n].mean(axis=0) for n in near]
    lacks = lacked(replace(SHAKEN, rotations=np.array(rotations), translations=np.array(positions)))
    assert lacks.found and lacks.missing > 0.5 and lacks.missing_px > 1


def test_what_is_not_smoothed_lacks_nothing() -> None:
    noise = np.random.default_rng(3).normal(0, 0.003, SHAKEN.translations.shape)
    jump = 0.5 * (np.arange(FRAMES)[:, None] >= 48)
    for more in (0.0, noise, jump):
        lacks = lacked(replace(SHAKEN, translations=SHAKEN.translations + more))
        assert not lacks.found and abs(lacks.missing) < 0.1


def test_poses_between_which_is_interpolated_are_not_called_smoothed() -> None:
    """A third of the poses, at other times than the frames."""
    sparse = path(TIMES_NS[::3] * 1e-9 + 0.01)
    assert judged(sparse).smoothing is None


JUMPED = replace(TRUTH, rotations=np.concatenate([TRUTH.rotations[:40], TRUTH.rotations[40:] @ so3_exp([0.05, 0, 0])]))
TURNING = drifted(TRUTH, Change(turning=np.radians([0.0, 3.0, 0.0])))


@pytest.mark.parametrize("tracked", [JUMPED, TURNING], ids=["a place", "all poses"])
def test_tracks_alone_deny_nothing_that_matches_confirm(tracked: Trajectory) -> None:
    """Tracks may slip together, as along a rail."""
    assert witnessed(tracked, tracked).verdict == "contradicted"
    judgement = witnessed(tracked, TRUTH)
    assert not judgement.denied and not found(judgement)


def test_without_matches_nothing_is_denied() -> None:
    few = tracks(0.3, JUMPED)
    chunk = replace(few, matches=lambda first, second: TwoViews(np.zeros((0, 2)), np.zeros((0, 2)), PIXEL))
    evidence = of_chunk(chunk, TRUTH, np.ones(FRAMES, bool))
    assert not judge(evidence, TRUTH, TIMES_NS, np.ones(FRAMES, bool)).denied
