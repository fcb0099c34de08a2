"""A rolling shutter in the joint window: frames as their middle row would have seen them, and where they are then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.estimators.modern.integrated.estimator import ModernIntegratedConfig
from ispom.estimators.modern.integrated.localise import localise
from ispom.estimators.modern.integrated.shutter import jacobian_by_rate, view_at_middle_row
from ispom.estimators.modern.integrated.state import ModernIntegratedState
from ispom.estimators.modern.integrated.window import JointWindow, Table, View
from ispom.estimators.modern.rolling import late_s, motion_at
from ispom.geometry import Array, Pose
from ispom.types import Camera, Rig
from tests.estimators.modern.setups import setup_of

CAMERA = Camera(640, 480, 460.0, 460.0, 319.5, 239.5, line_delay_s=0.02 / 479)
RIG_FROM_VIDEO = Pose.from_rotvec(np.array([0.02, -0.05, 0.01]), np.array([0.1, -0.05, 0.2]))
RIG = Rig.stereo(CAMERA, 0.4).changed(video=CAMERA, rig_from_video=RIG_FROM_VIDEO)
FRAME_S, PAIR_S, COUNT = 1 / 30, 1 / 3, 150


def at(t: float) -> Pose:
    """world_from_rig: ahead at 1.5 m/s, shaken at 2 and 3 Hz."""
    turn = 0.02 * np.sin(2 * np.pi * np.array([2.0, 3.0, 2.5]) * t + (0.3, 1.0, 2.0))
    return Pose.from_rotvec(turn, np.array([0.02 * np.sin(12 * t), 0.03 * np.sin(15 * t + 1), 1.5 * t]))


def seen(xyz: Array, t: float) -> tuple[Array, Array]:
    """(N, 2) normalised, of the video, and (N,) [s] when its rows were exposed after the middle one."""
    late = np.zeros(len(xyz))
    for _ in range(6):
        camera = [(at(t + s) @ RIG_FROM_VIDEO).inverse() for s in late]
        near = np.stack([pose.apply(p[None])[0] for pose, p in zip(camera, xyz, strict=True)])
        late = late_s(CAMERA, CAMERA.project(near)[:, 1])
    return near[:, :2] / near[:, 2:], late


def view_of(xyz: Array, t: float) -> View:
    uv, late = seen(xyz, t)
    return View(round(t * 1e9), True, 2 * np.arange(len(xyz)), uv, np.full(len(xyz), np.nan), late)


def view_at(t: float, video: bool) -> View:
    """Of nothing."""
    none = np.zeros(0)
    return View(round(t * 1e9), video, np.zeros(0, np.int64), np.zeros((0, 2)), none, none, world_from_rig=at(t))


@pytest.fixture(scope="module")
def xyz() -> Array:
    rng = np.random.default_rng(0)
    near = np.column_stack([rng.uniform(-0.55, 0.55, COUNT), rng.uniform(-0.4, 0.4, COUNT), np.ones(COUNT)])
    return (at(1.0) @ RIG_FROM_VIDEO).apply(near * rng.uniform(3, 20, (COUNT, 1)))


def window_of(xyz: Array, views: list[View]) -> JointWindow:
    """That knows the points."""
    values = np.column_stack([xyz[:, :2] / xyz[:, 2:], 1 / xyz[:, 2]])
    table = Table.empty().with_new(2 * np.arange(COUNT), Pose(), values)
    return replace(ModernIntegratedConfig().build(RIG).start().window, views=tuple(views), table=table)


@pytest.mark.parametrize("after_pair", [False, True])
def test_a_frame_is_put_together_by_the_motion_of_the_frames_before_it(xyz: Array, after_pair: bool) -> None:
    """Also just after a pair: the motion between pairs is that of a third of a second, and led 3 mm aside."""
    setup, now = setup_of(ModernIntegratedConfig().build(RIG)), 1.0
    before = [view_of(xyz, now - k * FRAME_S) for k in (4, 3, 2, 1)]
    views = [replace(v, world_from_rig=at(v.time_ns * 1e-9)) for v in before]
    if after_pair:
        views = [view_at(now - 0.01 - PAIR_S, False), *views, view_at(now - 0.01, False)]
    state, found, _ = localise(setup, ModernIntegratedState(window_of(xyz, views)), view_of(xyz, now))
    assert found is not None
    off = (at(now).inverse() @ state.window.views[-1].world_from_rig).log()
    assert np.abs(off[:3]).max() < 5e-4 and np.degrees(np.abs(off[3:])).max() < 0.02


def test_the_motion_of_a_camera_is_that_between_its_own_views() -> None:
    times = (0.0, 0.04, FRAME_S, 0.04 + PAIR_S)
    views = tuple(view_at(t, is_video) for t, is_video in zip(times, (True, False, True, False), strict=True))
    window = replace(ModernIntegratedConfig().build(RIG).start().window, views=views)
    for is_video, (a, b) in ((True, (0, 2)), (False, (1, 3))):
        motion = window.motion(is_video)
        way = Pose.exp(motion[:6] * (times[b] - times[a])) @ at(times[a]).inverse()
        np.testing.assert_allclose(way.matrix, at(times[b]).inverse().matrix, atol=1e-6)
        assert not motion[6:].any()
    assert not JointWindow(window.rig, window.rig).motion(True).any()


def test_what_a_frame_saw_follows_the_rate_by_which_its_rows_are_put_together(xyz: Array) -> None:
    now, step = 1.0, 1e-4
    window, view = window_of(xyz, [replace(view_at(now - FRAME_S, True), located=True)]), view_of(xyz, now)
    found = jacobian_by_rate(window, view)
    for i in range(6):
        motions = (np.eye(12)[i] * s for s in (step, -step))
        more, less = (view_at_middle_row(window, view, m).middle for m in motions)
        assert more is not None and less is not None
        np.testing.assert_allclose(found[:, :, i], (more - less) / (2 * step), atol=1e-6)


def test_rates_are_as_far_off_as_they_are_told_to_be(xyz: Array) -> None:
    """Of the way they are found, from true poses: those of four poses."""
    true, off, told = [], [], []
    for now in np.arange(1.0, 1.4, FRAME_S):
        views = [replace(view_at(now - k * FRAME_S, True), world_from_rig=at(now - k * FRAME_S)) for k in (4, 3, 2, 1)]
        state = ModernIntegratedState(window_of(xyz, views))
        state, _, _ = localise(setup_of(ModernIntegratedConfig().build(RIG)), state, view_of(xyz, now))
        newest = state.window.views[-1]
        told.append(replace(state.window, views=(newest,)).rate_variance())
        poses = [(round(t * 1e9), at(t)) for t in (now - 3 * FRAME_S, now - 2 * FRAME_S, now - FRAME_S, now)]
        h = 1e-4
        true.append((at(now + h).inverse() @ at(now - h)).log() / (2 * h))
        off.append(motion_at(poses, poses[-1][0])[:6] - true[-1])
    ratio = np.mean(np.square(off), axis=0).reshape(2, 3).mean(axis=1) / np.mean(told, axis=0)[[0, 3]]
    assert (ratio > 0.2).all() and (ratio < 3).all(), ratio


def test_two_poses_tell_a_rate_and_no_change_of_it() -> None:
    poses = [(0, at(0.0)), (round(FRAME_S * 1e9), at(FRAME_S))]
    first, second = np.split(motion_at(poses, poses[1][0]), 2)
    np.testing.assert_allclose(Pose.exp(first * FRAME_S).matrix, (at(FRAME_S).inverse() @ at(0.0)).matrix, atol=1e-9)
    assert not second.any()
