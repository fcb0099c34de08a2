"""A trajectory carried onto another."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Pose
from ispom.solvers.trajectory.anchoring import anchored
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
