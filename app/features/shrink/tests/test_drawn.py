"""Images of tracked points: nothing else of the recording is in them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from ispom_app.engine.events import Stepped
from ispom_app.features.shrink.drawn import GREY, drawn, points_of

from ispom.types import Measurement, Status, Step, Tracks, TrackStatus, images_of
from tests import doubles

AT = np.array([[40.0, 30.0], [60.25, 40.5]])


def test_the_images_depend_on_the_points_alone() -> None:
    part = doubles.sequence(6)

    def load(i: int) -> Measurement:
        measured = part.load(i)
        return replace(measured, images={n: 255 - image for n, image in images_of(measured).items()})

    points = {(int(t), "video"): (np.array([3, 7]), AT) for t in part.times_ns}
    for i in range(len(part)):
        own, other = (images_of(drawn(each, points).load(i)) for each in (part, replace(part, load=load)))
        for name, image in own.items():
            assert image.shape == images_of(part.load(i))[name].shape[:2]
            assert np.array_equal(image, other[name])
            assert (image == GREY).all() == (name != "video")


def test_a_point_moves_by_parts_of_a_pixel_and_keeps_its_texture() -> None:
    part = doubles.sequence(6)
    place = next(i for i, kind in enumerate(part.kinds) if kind == "video")
    time_ns = int(part.times_ns[place])
    shift = np.array([1.3, -0.6])
    before, after = (
        images_of(drawn(part, {(time_ns, "video"): (np.array([3]), AT[:1] + by)}).load(place))["video"]
        for by in (0 * shift, shift)
    )
    start = AT[:1].astype(np.float32).reshape(-1, 1, 2)
    found, status, _ = cv2.calcOpticalFlowPyrLK(before, after, start, None, winSize=(21, 21))  # type: ignore[call-overload]
    assert status.all() and np.abs(found[0, 0] - AT[0] - shift).max() < 0.05


def test_living_points_of_the_method_are_drawn_and_in_the_right_image_by_their_disparity() -> None:
    status = np.array([TrackStatus.ALIVE, TrackStatus.NEW, TrackStatus.LOST])
    uv, disparity = np.array([[10.0, 10], [20, 20], [30, 30]]), np.array([4.0, np.nan, 5])
    tracks = Tracks.of(np.array([1, 2, 3]), uv, status=status, disparity_px=disparity)
    step = Step(5, Status.TRACKING, "rig", None, tracks={"left": tracks}, method="stereo")
    stepped = Stepped(0, doubles.sequence(6).load(0), (step,), {}, {})
    found = points_of([stepped], "stereo")
    assert found[5, "left"][0].tolist() == [1, 2] and found[5, "right"][1].tolist() == [[6.0, 10.0]]
    assert points_of([stepped], "monocular") == {}
