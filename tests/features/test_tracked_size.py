"""Large images are tracked at a bounded width, and everything that is told is in their own pixels."""

from __future__ import annotations

import numpy as np

from ispom.features.images import TrackedSize
from ispom.types import Camera, Frame, Status, Step, Tracks, is_video

WIDE = Camera(3840, 2161, 2700.0, 2700.0, 1919.5, 1080.0)


def test_images_that_are_small_enough_stay_as_they_are() -> None:
    small = WIDE.scaled(1 / 3)
    size, frame = TrackedSize.of(small), Frame.video(0, np.zeros((720, 1280), np.uint8))
    step = Step(0, Status.TRACKING)
    assert size.tracked is small and size.reduced(frame) is frame and size.enlarged(step) is step


def test_large_ones_are_halved_until_they_are() -> None:
    size = TrackedSize.of(WIDE)
    assert (size.tracked.width, size.tracked.height) == (960, 540)
    assert TrackedSize.of(WIDE, 2000).tracked.width == 1920
    reduced = size.reduced(Frame.video(7, np.zeros((2161, 3840, 3), np.uint8)))
    assert is_video(reduced) and reduced.image.shape == (540, 960, 3) and reduced.time_ns == 7


def test_an_upright_image_is_tracked_as_large_as_one_that_lies() -> None:
    upright = Camera(2161, 3840, 2700.0, 2700.0, 1080.0, 1919.5)
    assert (TrackedSize.of(upright).tracked.width, TrackedSize.of(upright).tracked.height) == (540, 960)


def test_what_is_tracked_stands_where_the_camera_sees_it() -> None:
    size, xyz = TrackedSize.of(WIDE), np.array([[0.3, -0.2, 1.0], [-0.5, 0.3, 2.0]])
    uv = size.tracked.project(xyz).astype(np.float32)
    tracks = Tracks.of(np.arange(2), uv, residual_px=np.full(2, 0.25), disparity_px=np.full(2, 10.0))
    step = size.enlarged(Step(0, Status.TRACKING, tracks={"video": tracks}, residuals_px=np.full(2, 0.25)))
    found = step.tracks["video"]
    np.testing.assert_allclose(found.uv, WIDE.project(xyz), atol=1e-3)
    np.testing.assert_allclose(found.disparity_px, 40.0)
    np.testing.assert_allclose([*found.residual_px, *step.residuals_px], 1.0)
    assert np.isnan(found.uv_prev).all()
