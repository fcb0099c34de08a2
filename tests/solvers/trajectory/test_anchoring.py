"""A trajectory carried onto another."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Pose
from ispom.solvers.trajectory.anchoring import anchored, averaged
from ispom.types import Trajectory

TIMES = np.arange(11) * 10**8


def walk(turn: float = 0.1) -> Trajectory:
    return Trajectory.of(
        [
            (int(t), Pose.from_rotvec(np.array([0, turn * i, 0.02 * i]), np.array([i, 0.3 * i, i * i / 9])))
            for i, t in enumerate(TIMES)
        ]
    )


def test_a_rigid_motion_is_undone_everywhere() -> None:
    motion = Pose.from_rotvec(np.array([0.3, -0.2, 1.0]), np.array([5.0, 6.0, -7.0]))
    for places in ([0, 5, 10], [3, 7], [4]):
        found = anchored(walk().moved(left=motion), walk().select(np.array(places)))
        np.testing.assert_allclose(found.translations, walk().translations, atol=1e-9)
        np.testing.assert_allclose(found.rotations, walk().rotations, atol=1e-9)


def test_it_meets_the_anchors_and_keeps_its_shape_between() -> None:
    drifting, anchors = walk(turn=0.11), walk().select(np.array([0, 5, 10]))
    found = anchored(drifting, anchors)
    for t, pose in anchors.items():
        np.testing.assert_allclose(found.at(t).matrix, pose.matrix, atol=1e-9)  # type: ignore[union-attr]
    steps = np.linalg.norm(np.diff(found.translations, axis=0), axis=1)
    np.testing.assert_allclose(steps, np.linalg.norm(np.diff(walk().translations, axis=0), axis=1), rtol=0.3)


def test_without_common_times_nothing_changes() -> None:
    other = Trajectory.of([(7, Pose())])
    assert anchored(walk(), other) is not None
    np.testing.assert_array_equal(anchored(walk(), other).translations, walk().translations)


def test_the_mean_of_equal_corrections_is_each_of_them() -> None:
    motion = Pose.from_rotvec(np.array([0.3, -0.2, 1.0]), np.array([5.0, 6.0, -7.0]))
    for places in ([0, 2, 5, 6, 10], [3, 7], [4], []):
        found, wanted = (
            averaged(walk().moved(left=motion), walk().select(np.array(places, int)), 5),
            np.array(places, int),
        )
        np.testing.assert_array_equal(found.times_ns, TIMES[wanted])
        np.testing.assert_allclose(found.translations, walk().translations[wanted], atol=1e-9)
        np.testing.assert_allclose(found.rotations, walk().rotations[wanted], atol=1e-9)


def test_the_mean_of_corrections_is_that_of_the_nearest() -> None:
    """What is off at one anchor is shared by as many as are averaged, at the ends by fewer."""
    off = [(int(t), pose) for t, pose in walk().items()]
    shift = Pose.from_rotvec(np.array([0.0, 0.0, 0.1]), np.zeros(3))
    off[1] = (off[1][0], Pose(shift.rotation @ off[1][1].rotation, off[1][1].translation + np.array([0.0, 0.6, 0.0])))
    found = averaged(walk(), Trajectory.of(off), 3)
    turned = [np.linalg.norm((found.pose(i) @ walk().pose(i).inverse()).rotvec) for i in range(len(TIMES))]
    np.testing.assert_allclose(turned, [0.05, 0.1 / 3, 0.1 / 3, *[0.0] * 8], atol=1e-9)
    np.testing.assert_allclose(found.translations[1], walk().translations[1] + np.array([0.0, 0.2, 0.0]), atol=1e-9)


def test_the_noise_of_anchors_is_averaged() -> None:
    rng = np.random.default_rng(0)
    long = Trajectory.of(
        [(i, Pose.from_rotvec(np.array([0, 0.1 * i, 0]), np.array([i, 0.0, 0.0]))) for i in range(400)]
    )
    noise = [Pose.from_rotvec(*0.01 * rng.standard_normal((2, 3))) for _ in range(400)]
    noisy = Trajectory.of([(t, pose @ each) for (t, pose), each in zip(long.items(), noise, strict=True)])
    found = averaged(long, noisy, 5)
    off = np.array([(long.pose(i).inverse() @ found.pose(i)).rotvec for i in range(400)])
    np.testing.assert_allclose(off.std(), 0.01 / np.sqrt(5), rtol=0.1)
