"""A thing that is moved before a camera and the scene behind it are two rigid motions, and said to be."""

from __future__ import annotations

import numpy as np

from ispom.estimators.modern.second_motion import second_motion
from ispom.geometry import Pose

SIGMA = 0.001


def seen(count: int, moved: Pose, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Normalised coordinates (N, 2) before and after the points moved."""
    rng = np.random.default_rng(seed)
    xyz = np.column_stack([rng.uniform(-2, 2, (count, 2)), rng.uniform(4, 9, count)])
    both = [p[:, :2] / p[:, 2:] + 0.3 * SIGMA * rng.standard_normal((count, 2)) for p in (xyz, moved.apply(xyz))]
    return both[0], both[1]


def test_a_still_background_behind_a_moved_thing_is_a_second_motion() -> None:
    moved = Pose.from_rotvec(np.array([0.1, -0.05, 0.02]), np.array([0.3, 0.0, 0.2]))
    (toy1, toy2), (wall1, wall2) = seen(120, moved, 0), seen(60, Pose(), 1)
    x1, x2 = np.concatenate([toy1, wall1]), np.concatenate([toy2, wall2])
    found = second_motion(x1, x2, np.arange(180) >= 120, SIGMA)
    assert not found.passed and found.value > 0.3


def test_another_moved_thing_is_one_as_well() -> None:
    a = seen(120, Pose.from_rotvec(np.array([0.0, 0.02, 0.0]), np.array([0.1, 0.0, 0.3])), 2)
    b = seen(60, Pose.from_rotvec(np.array([0.1, 0.0, 0.1]), np.array([-0.5, 0.2, 0.0])), 3)
    x1, x2 = (np.concatenate([p, q]) for p, q in zip(a, b, strict=True))
    assert not second_motion(x1, x2, np.arange(180) >= 120, SIGMA).passed


def test_tracks_gone_astray_are_none() -> None:
    x1, x2 = seen(180, Pose.from_rotvec(np.zeros(3), np.array([0.2, 0.0, 0.1])), 4)
    astray = np.arange(180) >= 130
    x2[astray] += np.random.default_rng(5).uniform(-0.2, 0.2, (50, 2))
    assert second_motion(x1, x2, astray, SIGMA).passed
    assert second_motion(x1, x2, np.arange(180) >= 175, SIGMA).value == 0.0, "too few to tell"
