"""A segment is joined with an earlier one where keyframes recognise it: by a similarity, with its covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ispom.estimators.modern.keyframe_database import Keyframe
from ispom.estimators.modern.lens import Lens
from ispom.estimators.modern.monocular import keyframe as keyframes
from ispom.estimators.modern.monocular.covariance import MapUncertainty
from ispom.estimators.modern.monocular.estimator import ModernMonocularConfig
from ispom.estimators.modern.monocular.join import agree, covariance_at, measure
from ispom.estimators.modern.monocular.match_keyframes import KeyframeMatch
from ispom.estimators.modern.monocular.setup import Setup
from ispom.estimators.modern.monocular.worlds import Recognised, Worlds
from ispom.geometry import Array, Pose, Similarity
from ispom.types import Camera, Decision, Measurement, Sequence, Step, is_video
from tests.alone import run
from tests.estimators.modern.setups import monocular_setup

GREY = np.zeros((48, 64), np.uint8)
SIMILARITY = Similarity(2.5, Pose(Rotation.from_euler("xyz", (0.3, -0.2, 1.0)).as_matrix(), np.array([4.0, -1.0, 2.0])))
"""earlier_from_own."""
CAMERA = Camera(640, 480, 500.0, 500.0, 319.5, 239.5)


@pytest.fixture
def setup() -> Setup:
    return monocular_setup(CAMERA)


def uncertain(relative: float) -> MapUncertainty:
    none = np.zeros((0, 3, 6))
    pose = np.diag(np.repeat([1e-3, 1e-3], 3) ** 2)
    return MapUncertainty((), np.zeros(0, np.int64), none, pose, none, 1.0, pose, 0.01, 0.01, 0.01, relative)


def measured(
    setup: Setup, noise: float = 0.0, relative: float = 0.02, count: int = 80, seed: int = 0
) -> Recognised | None:
    """Of a keyframe whose points have errors: `noise` [rad] in the image, and ten times that in ln depth."""
    rng = np.random.default_rng(seed)
    world_from_camera = Pose(Rotation.from_euler("y", 0.4).as_matrix(), np.array([1.0, 2.0, 3.0]))
    near = np.column_stack([rng.uniform(-0.5, 0.5, (count, 2)), np.ones(count)]) * rng.uniform(2, 9, count)[:, None]
    own = world_from_camera.apply(near * np.exp(rng.normal(0, 10 * noise, (count, 1))))
    earlier = SIMILARITY.apply(world_from_camera.apply(near))
    x = near[:, :2] / near[:, 2:] + rng.normal(0, noise, (count, 2)) if noise else near[:, :2] / near[:, 2:]
    uv = CAMERA.fx * x + (319.5, 239.5)
    pose = SIMILARITY.apply_pose(world_from_camera)
    old = Keyframe.of(1, pose.inverse(), (GREY,), np.diag([1e-6] * 6), segment=0, depth_sigma=0.01)
    key = Keyframe.of(9, world_from_camera.inverse(), (GREY,), None, segment=1)
    match = KeyframeMatch(((old, uv),), earlier, uv.astype(np.float32), pose, np.arange(count))
    return measure(setup, Lens(CAMERA, np.zeros(2)), match, key, own, uncertain(relative))


def off(found: Recognised, true: Similarity) -> Array:
    """(7,) right perturbation of the earlier pose of the keyframe from the true one."""
    expected = true @ Similarity(1.0, found.world_from_camera)
    error = expected.inverse() @ found.earlier_from_camera
    return np.concatenate([error.pose.translation, error.pose.rotvec, [np.log(error.scale)]])


def test_exact_points_give_the_exact_similarity(setup: Setup) -> None:
    found = measured(setup)
    assert found is not None and (found.segment, found.earlier, found.pair) == (1, 0, (1, 9))
    np.testing.assert_allclose(off(found, SIMILARITY), 0, atol=2e-6)
    assert found.earlier_from_own.scale == pytest.approx(2.5, rel=1e-6)


def test_its_scale_is_no_surer_than_the_depths_of_both_segments(setup: Setup) -> None:
    sure, vague = measured(setup, relative=0.0), measured(setup, relative=0.3)
    assert sure is not None and vague is not None
    assert sure.scale_sigma >= 0.01 and vague.scale_sigma >= 0.3


def test_its_errors_agree_with_its_covariance(setup: Setup) -> None:
    squared = []
    for seed in range(60):
        found = measured(setup, noise=0.34 / 500, relative=0.0, seed=seed)
        assert found is not None
        error = off(found, SIMILARITY)
        squared.append(error @ np.linalg.solve(found.covariance, error))
    assert np.mean(squared) < 7, "it may be too careful: the earlier segment was exact here"


def test_too_few_points_give_none(setup: Setup) -> None:
    assert measured(setup, count=10) is None


def test_two_keyframes_agree_on_one_similarity(setup: Setup) -> None:
    one, other = measured(setup, noise=0.34 / 500, seed=1), measured(setup, noise=0.34 / 500, seed=2)
    assert one is not None and other is not None and agree(one, other)


@pytest.mark.parametrize("by", [Similarity(1.4), Similarity(1.0, Pose(translation=np.array([6.0, 0.0, 0.0])))])
def test_they_do_not_agree_on_others(setup: Setup, by: Similarity) -> None:
    one = measured(setup, relative=0.0)
    assert one is not None
    assert not agree(one, replace(one, earlier_from_camera=by @ one.earlier_from_camera))


def recognised(segment: int, earlier: int, similarity: Similarity) -> Recognised:
    """At the origin of its segment."""
    some = np.diag([1e-4] * 7)
    return Recognised(segment, earlier, similarity, some, Pose(), np.diag([1e-6] * 6), 0.01, 5.0)


def test_joins_of_joins_are_composed() -> None:
    worlds = Worlds().visited(0, 0, 0).visited(1, 10, 4).visited(2, 20, 9)
    worlds = worlds.joined_by(recognised(2, 1, Similarity(3.0)), 12)
    assert [worlds.root(s) for s in range(3)] == [0, 1, 1]
    worlds = worlds.visited(1, 30, 12).joined_by(recognised(1, 0, Similarity(2.0)), 15)
    assert [worlds.root(s) for s in range(3)] == [0, 0, 0]
    assert [worlds.root_from(s).scale for s in range(3)] == [1, 2, 6]
    moved = [worlds.correction.applied(t, Pose(translation=np.ones(3))).translation[0] for t in (5, 15, 25, 35)]
    np.testing.assert_allclose(moved, [1, 2, 6, 2])


def test_all_poses_since_the_segment_began_are_revised_in_parts() -> None:
    worlds = Worlds().visited(0, 0, 0).visited(1, 10, 40).joined_by(recognised(1, 0, Similarity(2.0)), 100)
    parts = []
    while worlds.pending:
        worlds, part = worlds.next_pending(25)
        parts.append(part)
    assert [(p.start, p.stop) for p in parts] == [(75, 100), (50, 75), (40, 50)]


def test_the_covariance_of_a_joined_pose_contains_that_of_the_join() -> None:
    join = recognised(1, 0, Similarity(2.0))
    worlds = Worlds().visited(0, 0, 0).visited(1, 10, 40).joined_by(join, 100)
    at = covariance_at(worlds, join, Pose(), join.own_covariance, 0.01)
    np.testing.assert_allclose(np.diag(at), 1e-4, rtol=0.2)
    later = covariance_at(worlds, join, Pose(translation=np.array([0.0, 0.0, 50.0])), 4 * join.own_covariance, 0.02)
    assert later[2, 2] > 50**2 * 1e-4, "an uncertain unit lengthens the way since"


@pytest.fixture(scope="module")
def joined(flight: Sequence, exposures: list[Measurement]) -> tuple[list[Step], Pose]:
    """Steps of a flight whose scale is declared lost at the second keyframe of its map; the last pose of the same
    flight in one segment."""
    estimator, whole, count = ModernMonocularConfig(min_parallax_deg=1.0).build(flight.rig), list[Step](), 0

    def check(before: tuple[float, ...], uncertainty: MapUncertainty, known: bool = False) -> Decision:
        nonlocal count
        found, count = usual(before, uncertainty, known), count + 1
        return replace(found, passed=count != 2)

    usual = keyframes.check_scale
    for patched in (False, True):
        with pytest.MonkeyPatch.context() as patch:
            if patched:
                patch.setattr(keyframes, "check_scale", check)
            steps = list(run(estimator, filter(is_video, exposures)))
        whole = whole or steps
    last = whole[-1].world_from_frame
    assert last is not None
    return steps, last


def test_a_segment_is_joined_where_it_recognises_the_one_before(joined: tuple[list[Step], Pose]) -> None:
    steps, last = joined
    assert sum(s.restarted for s in steps) == 1
    (join,) = [s for s in steps if s.joins is not None]
    assert join.joins == 0 and join.key_frame and {d.key for d in join.decisions} >= {"join_points", "join_scale"}
    assert len(join.revised) > 1
    found = steps[-1].world_from_frame
    assert found is not None
    assert np.linalg.norm(found.translation - last.translation) < 0.1 * np.linalg.norm(last.translation)
