"""Structure from motion: exact images give the exact poses back, and only key images have any in the end."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.testing import assert_allclose

from ispom.estimators.survey.sfm import SfmConfig
from ispom.geometry import Pose
from ispom.testing import check_estimator
from ispom.types import Camera, Frame, Rig, Status, Step, Tracks, Trajectory
from tests.alone import alone, run

CAMERA = Camera(640, 480, 400.0, 400.0, 319.5, 239.5)
RNG = np.random.default_rng(5)
POINTS = RNG.uniform([-6, -3, 6], [6, 3, 20], (150, 3))
GREY = np.zeros((480, 640), np.uint8)


def seen(pose: Pose, key_frame: bool, time_ns: int) -> Step:
    """What a visual method says that knows its pose only roughly."""
    uv = CAMERA.project(pose.inverse().apply(POINTS))
    tracks = Tracks.of(np.arange(len(POINTS)), uv, residual_px=np.zeros(len(POINTS)))
    rough = pose @ Pose.exp(RNG.normal(0, 0.01, 6)) if time_ns > 1 else pose
    return Step(time_ns, Status.TRACKING, "video", rough, tracks={"video": tracks}, key_frame=key_frame)


def test_all_images_are_adjusted_together_and_only_key_images_have_poses() -> None:
    true = [Pose(translation=np.array([0.4 * i, 0.05 * i, 0.1 * i])) for i in range(12)]
    sfm: Any = SfmConfig().build(Rig.single(CAMERA))
    state = sfm.start()
    for i, pose in enumerate(true):
        state, _ = sfm.step(state, Frame.video(i, GREY), {"visual": seen(pose, i % 3 != 2, i)})
    found = sfm.finish(state, {"visual": Trajectory.empty("video")})
    assert found.times_ns.tolist() == [i for i in range(12) if i % 3 != 2]
    expected = np.array([true[t].translation for t in found.times_ns])
    assert_allclose(found.translations, expected, atol=1e-4)


def test_a_new_segment_of_the_visual_method_is_one_here_and_joins_as_it_does() -> None:
    """Frame 4 begins a segment without a key image, which only frame 6 is; frame 8 recognises the first one."""
    sfm: Any = SfmConfig().build(Rig.single(CAMERA))
    state, steps = sfm.start(), []
    for i in range(10):
        pose = Pose(translation=np.array([0.4 * i, 0.0, 0.0]))
        visual = replace(seen(pose, i % 2 == 0 and i != 4, i), restarted=i == 4, joins=0 if i == 8 else None)
        state, step = sfm.step(state, Frame.video(i, GREY), {"visual": visual})
        steps.append(step)
    assert [i for i, step in enumerate(steps) if step.restarted] == [6]
    assert [(i, step.joins) for i, step in enumerate(steps) if step.joins is not None] == [(8, 0)]
    assert [image.segment for image in state.images] == [0, 0, 1, 1]


def test_it_keeps_the_contract_and_gives_fewer_poses_than_frames() -> None:
    check_estimator("sfm")


def test_it_is_run_with_the_method_that_it_asks(flight, exposures) -> None:
    method = alone("sfm", flight.rig)
    frames = [e for e in exposures if e.kind == "video"][:60]
    steps = list(run(method, frames))
    keys = sum(step.key_frame for step in steps)
    assert 3 <= keys < len(steps) / 2
