"""The interval of the frames is that of most of them."""

from __future__ import annotations

from ispom.estimators.frame_interval import REMEMBERED, FrameInterval


def test_one_bad_time_stamp_and_missing_frames_change_nothing() -> None:
    found, time_ns = FrameInterval(), 0
    assert found.median_ns is None
    for passed_ns in [33, 33, 33, 1, 65, 33, 99, 33]:
        time_ns += passed_ns
        found = found.after(time_ns)
    assert found.median_ns == 33


def test_it_follows_a_camera_that_slows_down_and_does_not_grow() -> None:
    found = FrameInterval()
    for i in range(100):
        found = found.after(i * 33)
    for i in range(1, 10):
        found = found.after(99 * 33 + i * 200)
    assert found.median_ns == 200 and len(found.recent_ns) == REMEMBERED


def test_a_clock_set_back_is_no_interval() -> None:
    assert FrameInterval().after(100).after(50).recent_ns == ()
