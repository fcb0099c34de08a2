"""The path of mirrored images is known by its rotations and steps, and no other path passes for one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.evaluation.mirrored import mirrored
from ispom.geometry import Pose
from ispom.types import Camera, Rig, Trajectory

TIMES_NS = np.arange(40) * 33_000_000
RIG = Rig.of(
    video=Camera(320, 240, 226, 226, 160, 120),
    rig_from_video=Pose.from_rotvec(np.array([0.02, -0.03, 0.01]), np.array([0.03, -0.05, 0.03])),
)


def path(level: bool = False, turns: float = 1.0) -> Trajectory:
    """world_from_rig of a camera that winds its way ahead; `level`: without leaving the ground, as a car."""
    t = np.linspace(0, 1, len(TIMES_NS))
    rise = 0 if level else 1
    turned = turns * np.column_stack([rise * 0.2 * np.sin(7 * t), 0.6 * np.sin(4 * t), rise * 0.1 * np.sin(9 * t)])
    poses, position = [], np.zeros(3)
    for rotvec in turned:
        pose = Pose.from_rotvec(rotvec, position)
        poses.append(pose)
        position = position + pose.rotation @ (0.01, -0.003 * rise, 0.05)
    return Trajectory.of(list(zip(TIMES_NS.tolist(), poses, strict=True)))


def seen(truth: Trajectory, mirror: tuple[int, int, int] = (1, 1, 1), turn: Pose | None = None) -> Trajectory:
    """world_from_video in another world and unit, of images that are mirrored; `turn`: of other axes of the camera."""
    own, m = truth.moved(right=RIG.rig_from_video @ (turn or Pose()), frame="video"), np.diag(mirror)
    made = replace(own, rotations=m @ own.rotations @ m, translations=3.0 * own.translations @ m)
    return made.moved(left=Pose.from_rotvec(np.array([1.0, -2, 0.5]), np.array([3.0, 2, 1])))


@pytest.mark.parametrize(
    ("level", "mirror", "words"),
    [
        (False, (1, 1, 1), ""),
        (False, (-1, 1, 1), "left-right"),
        (False, (1, -1, 1), "top-bottom"),
        (True, (1, 1, 1), ""),
        (True, (-1, 1, 1), "left-right"),
        (True, (1, -1, 1), ""),
    ],
)
def test_mirrored_images_are_told(level: bool, mirror: tuple[int, int, int], words: str) -> None:
    """Of a camera that stays level, a mirror of top and bottom changes nothing in the path."""
    truth = path(level)
    assert mirrored(seen(truth, mirror), truth, RIG) == words


def test_other_axes_of_the_camera_are_no_mirror() -> None:
    truth = path()
    for axis in np.eye(3):
        assert mirrored(seen(truth, turn=Pose.from_rotvec(np.pi * axis, np.zeros(3))), truth, RIG) == ""


def test_a_camera_that_hardly_turns_cannot_tell() -> None:
    truth = path(turns=0.01)
    assert mirrored(seen(truth, (-1, 1, 1)), truth, RIG) == ""


def test_a_path_of_noise_is_no_mirror() -> None:
    truth, rng = path(), np.random.default_rng(1)
    noise = Trajectory.of([
        (int(t), Pose.from_rotvec(rng.normal(0, 0.3, 3), rng.normal(0, 1, 3))) for t in TIMES_NS
    ])  # fmt: skip
    assert mirrored(replace(noise, frame="video"), truth, RIG) == ""
    assert mirrored(seen(truth).select(TIMES_NS[8] > TIMES_NS), truth, RIG) == ""
