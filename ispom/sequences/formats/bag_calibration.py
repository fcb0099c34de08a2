"""The calibration of a topic of images in a bag: its camera_info, and when two topics are a rectified pair."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.io.bag_file import IMAGE_TYPES, INFO_TYPE, BagFile
from ispom.io.calibrations.camera_info import camera_info
from ispom.io.calibrations.pair import pair_fault
from ispom.types import Camera

_IMAGE = re.compile(r"image(_(raw|rect|color|colour|mono|gray|grey)+)*")


@dataclass(frozen=True, eq=False)
class TopicInfo:
    """A camera_info: the raw camera, and how it is rectified."""

    raw: Camera
    turn: Array
    """(3, 3) rectified_from_raw."""
    projection: Array
    """(3, 4) projection of the rectified image; zero where the camera was not calibrated."""
    topic: str = ""
    notes: tuple[str, ...] = ()

    @property
    def rectified(self) -> Camera:
        fx, fy, cx, cy = self.projection[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
        return Camera(self.raw.width, self.raw.height, fx, fy, cx, cy)

    @property
    def is_straight(self) -> bool:
        """Whether its raw images are already rectified and without distortion."""
        same = self.raw.lens == "opencv" and not any(self.raw.distortion) and (self.turn == np.eye(3)).all()
        return bool(same and (self.raw.matrix == self.rectified.matrix).all())


def usable_info(bag: BagFile, topic: str) -> TopicInfo | InputError | None:
    """Returns the topic's camera_info, or the error for which it cannot be used; None where it is missing or empty."""
    try:
        return _info(bag, topic)
    except InputError as fault:
        return fault


def _info(bag: BagFile, topic: str) -> TopicInfo | None:
    """Returns the topic's camera_info; None where it is missing or empty. Raises InputError for an unusable camera."""
    name = _info_topic(bag, topic)
    message = bag.message(name) if name else None
    if message is None:
        return None

    def value(key: str) -> Any:  # ROS 1 has capitals
        attribute = getattr(message, key, getattr(message, key.upper(), ()))
        return np.asarray(attribute, float).tolist()

    content: dict[str, Any] = {key: value(key) for key in "kdrp"}
    if not any(content["k"]) and not any(content["p"]):  # uncalibrated (sensor_msgs/CameraInfo)
        return None
    content |= {key: getattr(message, key) for key in ("width", "height", "distortion_model", "binning_x", "binning_y")}
    region = ("x_offset", "y_offset", "width", "height")
    content["roi"] = {key: int(getattr(message.roi, key)) for key in region}
    info = camera_info(bag.path, content, where=f"{name}: ")
    projection = np.zeros((3, 4)) if info.projection is None else info.projection
    return TopicInfo(info.raw, info.turn, projection, name, info.notes)


def _info_topic(bag: BagFile, topic: str) -> str:
    """Returns the topic of an image topic's camera_info; "" without one.

    It is a neighbour or a child of the topic, at the place where RealSense's recorder puts it, a topic with a similar
    name, or one level higher, if no other camera has images there.
    """
    topic = topic.removesuffix("/compressed")
    place, name = topic.rsplit("/", 1)
    above = place.rsplit("/", 1)[0]
    called = [_IMAGE.sub(word, name) for word in ("camera_info", "info")] if _IMAGE.search(name) else []
    usual = [
        *(f"{place}/{each}" for each in called if each not in ("camera_info", "info")),
        f"{topic}/camera_info",
        f"{topic}_info",
        f"{topic}/info",
        f"{place}/camera_info",
        f"{place.removesuffix('/image')}/info/camera_info",
        f"{place}/camerainfo",
        f"{place}/info",
    ]
    images = [each for each, kind in bag.types.items() if kind in IMAGE_TYPES]
    below = {each[len(above) + 1 :].split("/")[0] for each in images if each.startswith(f"{above}/")}
    if place and below == {place[len(above) + 1 :]}:
        usual += [f"{above}/camera_info"]
    return next((each for each in usual if bag.types.get(each) == INFO_TYPE), "")


def baseline_m(left: TopicInfo, right: TopicInfo) -> float:
    """Returns the baseline [m]; 0 unless the right projection is the left one, moved to the right."""
    p, q = left.projection, right.projection
    if q[0, 0] <= 0 or abs(q[:, :3] - p[:, :3]).max() > 1e-6 * q[0, 0] or left.rectified != right.rectified:
        return 0.0
    return float((p[0, 3] - q[0, 3]) / q[0, 0])


def fault_of_pair(left: TopicInfo, right: TopicInfo) -> str:
    """Returns one clause with the reason why the two are no rectified pair; empty if they are one."""
    p, q = left.projection, right.projection
    if p[0, 0] <= 0 or q[0, 0] <= 0:
        return "a P of their camera_info is zero: calibrate them as a pair"
    if abs(q[:, :3] - p[:, :3]).max() > 1e-6 * q[0, 0] or left.rectified != right.rectified:
        return "their P differ by more than a baseline: calibrate them as a pair"
    shift = [(p[i, 3] - q[i, 3]) / q[i, i] for i in (0, 1)]
    return pair_fault(Pose(translation=np.array([*shift, 0.0])))
