"""The paper's window of key frames stays small where no key frame comes."""

from __future__ import annotations

import numpy as np

from ispom.estimators.paper.monocular import MAX_WAITING, KeyframeWindow
from ispom.estimators.tracked_frame import TrackedFrame
from ispom.geometry import Pose


def frame(i: int, pose: Pose | None = None) -> TrackedFrame:
    return TrackedFrame(i * 33_000_000, np.arange(5), np.zeros((5, 2)), pose)


def test_frames_without_a_key_frame_are_settled_with_the_poses_they_have() -> None:
    window, settled = KeyframeWindow().with_keyframe(frame(0)), []
    for i in range(1, 2 * MAX_WAITING + 1):
        pose = Pose(translation=np.array([i, 0.0, 0.0])) if i % 2 else None
        window, done = window.with_frame(frame(i, pose)).settle(3)
        settled += done
    assert len(window.frames) == 1 + MAX_WAITING and window.frames[0] == window.keys[0]
    assert [t for t, _ in settled] == [frame(i).time_ns for i in range(1, MAX_WAITING + 1, 2)]
    assert settled[-1][1].translation[0] == MAX_WAITING - 1


def test_frames_before_the_oldest_key_frame_are_settled() -> None:
    window = (
        KeyframeWindow()
        .with_keyframe(frame(0))
        .with_frame(frame(1, Pose()))
        .with_keyframe(frame(2))
        .with_keyframe(frame(3))
    )
    window, settled = window.settle(2)
    assert [t for t, _ in settled] == [0, frame(1).time_ns]
    assert [f.time_ns for f in window.frames] == [frame(2).time_ns, frame(3).time_ns]
