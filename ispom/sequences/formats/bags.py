"""Image topics of a ROS 1 bag, a ROS 2 bag or an MCAP file, with the camera_info beside them: one camera or a pair."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ispom.errors import InputError, UnreadableImage
from ispom.geometry import Array, Pose
from ispom.io.calibrations.camera_info import camera_info
from ispom.io.calibrations.pair import pair_fault
from ispom.io.calibrations.recognised import any_camera
from ispom.io.camera import usable
from ispom.io.files import exists, is_folder
from ispom.sequences.formats.bag_file import IMAGE_TYPES, INFO_TYPE, METADATA, BagFile, Index
from ispom.sequences.formats.folder import CAMERA, CAMERA_ENTRIES
from ispom.sequences.image_header import header_size
from ispom.sequences.images import decode
from ispom.sequences.matching import pairs, unmatched_note
from ispom.sequences.recording import Recording, Side
from ispom.sequences.rectification import remapped, undistortion
from ispom.types import Camera, Image

BAG_SUFFIXES = frozenset({".bag", ".mcap", ".db3"})
SIDES = (("left", "right"), ("cam0", "cam1"), ("camera0", "camera1"), ("infra1", "infra2"))
"""How topics of a pair are called."""
ENCODINGS: dict[str, tuple[int, int | None]] = {
    "mono8": (1, None),
    "8UC1": (1, None),
    "rgb8": (3, None),
    "bgr8": (3, cv2.COLOR_BGR2RGB),
    "8UC3": (3, cv2.COLOR_BGR2RGB),
    "rgba8": (4, cv2.COLOR_RGBA2RGB),
    "bgra8": (4, cv2.COLOR_BGRA2RGB),
    "bayer_rggb8": (1, cv2.COLOR_BayerRGGB2RGB),
    "bayer_bggr8": (1, cv2.COLOR_BayerBGGR2RGB),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGBRG2RGB),
    "bayer_grbg8": (1, cv2.COLOR_BayerGRBG2RGB),
}
"""Bytes per pixel, and what makes RGB of them."""


@dataclass(frozen=True, eq=False)
class _Info:
    """A camera_info: the raw camera, and how it is rectified."""

    raw: Camera
    turn: Array
    """(3, 3) rectified_from_raw."""
    projection: Array
    """(3, 4) of the rectified image; all zero where the camera was not calibrated."""
    notes: tuple[str, ...] = ()

    @property
    def rectified(self) -> Camera:
        fx, fy, cx, cy = self.projection[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
        return Camera(self.raw.width, self.raw.height, fx, fy, cx, cy)

    @property
    def is_straight(self) -> bool:
        """Whether its raw images are as rectified ones are to be."""
        same = self.raw.lens == "opencv" and not any(self.raw.distortion) and (self.turn == np.eye(3)).all()
        return bool(same and (self.raw.matrix == self.rectified.matrix).all())


def looks_like_bag(path: Path) -> bool:
    """Whether it is called a bag, or is the folder of a ROS 2 bag."""
    return path.suffix.lower() in BAG_SUFFIXES or (is_folder(path) and exists(path / METADATA))


def open_bag(path: Path) -> Recording:
    """The recording of a bag's stereo pair, or else of its first camera; InputError names what is missing or wrong.

    Opening reads the bag once, for the times of its images.
    """
    bag = BagFile(path)
    topics = sorted((topic for topic, kind in bag.types.items() if kind in IMAGE_TYPES), key=_rank)
    if not topics:
        raise InputError(f"{path} has no image topic: give a bag with images")
    infos = {topic: _info(bag, topic) for topic in topics}
    reasons = []
    for left in topics:
        right = next((left.replace(*names) for names in SIDES if names[0] in left), left)
        first, second = infos[left], infos.get(right)
        if right == left or first is None or second is None:
            continue
        if not (fault := _pair_fault(first, second)):
            return _pair(bag, (left, right), (first, second))
        reasons.append(f"{path.name}: {left} and {right} are not used as a pair: {fault}")
    alone = _single(bag, topics[0], infos[topics[0]], topics[1:])
    return replace(alone, notes=(*alone.notes, *reasons[:1]))


def _single(bag: BagFile, topic: str, info: _Info | None, others: list[str]) -> Recording:
    beside = bag.path.resolve().parent / CAMERA
    if info is None and not exists(beside):
        raise InputError(f"{bag.path} has no camera_info for {topic}: write {beside} with {CAMERA_ENTRIES}")
    camera = any_camera(beside) if info is None else info.raw
    if info is not None and _is_rectified(topic):
        camera = usable(info.rectified, f"{bag.path}: P of {topic}")
    index = _index(bag, topic)
    _require_size(bag, topic, index, camera if info is None else info.raw)
    notes = () if info is None else info.notes
    notes += (f"Of {bag.path.name} only {topic} is used, not {', '.join(others)}.",) if others else ()

    def read(_: Side, i: int) -> Image:
        return _image(bag, topic, index, i, camera)

    return Recording(f"bag {bag.path.name}", camera, None, index.stamps_ns, read, None, notes)


def _pair(bag: BagFile, topics: tuple[str, str], infos: tuple[_Info, _Info]) -> Recording:
    left, right = _index(bag, topics[0]), _index(bag, topics[1])
    i_left, i_right = pairs(left.stamps_ns, right.stamps_ns)
    if not len(i_left):
        raise InputError(f"{bag.path}: no images of {' and '.join(topics)} are of the same time: record both together")
    camera = usable(infos[0].rectified, f"{bag.path}: P of {topics[0]}")
    for topic, index, info in zip(topics, (left, right), infos, strict=True):
        _require_size(bag, topic, index, info.raw)
    size = (camera.width, camera.height)
    maps = [undistortion(info.raw, info.turn, info.projection, size) for info in infos]
    streams = {"left": (0, left, i_left), "right": (1, right, i_right)}

    def read(side: Side, i: int) -> Image:
        k, index, matched = streams[side]
        image = _image(bag, topics[k], index, int(matched[i]), infos[k].raw)
        return image if _is_rectified(topics[k]) or infos[k].is_straight else remapped(image, maps[k])

    notes = infos[0].notes + infos[1].notes + unmatched_note(len(left.places), len(right.places), len(i_left))
    baseline_m = _baseline_m(*infos)
    return Recording(f"bag {bag.path.name}", camera, baseline_m, left.stamps_ns[i_left], read, None, notes)


def _rank(topic: str) -> tuple[bool, bool, bool, str]:
    """Cameras before depth images, rectified before raw, as they are before compressed."""
    return "depth" in topic.lower(), not _is_rectified(topic), topic.endswith("/compressed"), topic


def _is_rectified(topic: str) -> bool:
    return "rect" in topic.removesuffix("/compressed").rsplit("/", 1)[-1]


def _baseline_m(left: _Info, right: _Info) -> float:
    """0 where they are not calibrated as a pair: one projection, moved to the right."""
    p, q = left.projection, right.projection
    if q[0, 0] <= 0 or abs(q[:, :3] - p[:, :3]).max() > 1e-6 * q[0, 0] or left.rectified != right.rectified:
        return 0.0
    return float((p[0, 3] - q[0, 3]) / q[0, 0])


def _pair_fault(left: _Info, right: _Info) -> str:
    """Why the two are no rectified pair, one clause; empty where they are one."""
    p, q = left.projection, right.projection
    if p[0, 0] <= 0 or q[0, 0] <= 0:
        return "a P of their camera_info is zero: calibrate them as a pair"
    if abs(q[:, :3] - p[:, :3]).max() > 1e-6 * q[0, 0] or left.rectified != right.rectified:
        return "their P differ by more than a baseline: calibrate them as a pair"
    shift = [(p[i, 3] - q[i, 3]) / q[i, i] for i in (0, 1)]
    return pair_fault(Pose(translation=np.array([*shift, 0.0])))


def _require_size(bag: BagFile, topic: str, index: Index, camera: Camera) -> None:
    """InputError where the first image is not as large as its camera_info says: then none is."""
    message = bag.message(topic, index.places[0])
    if bag.types[topic] == IMAGE_TYPES[0]:
        found = (message.width, message.height)
    else:
        found = header_size(bytes(message.data), f"{bag.path}: image 0 of {topic}")
    if found is not None and found != (camera.width, camera.height):
        raise InputError(
            f"{bag.path}: images of {topic} are {found[0]} x {found[1]}, not {camera.width} x {camera.height} as their "
            "camera_info says: correct the calibration"
        )


def _index(bag: BagFile, topic: str) -> Index:
    index = bag.index(topic)
    if not index.places:
        raise InputError(f"{bag.path}: {topic} holds no image: give a bag with images")
    return index


def _info(bag: BagFile, topic: str) -> _Info | None:
    name = f"{topic.removesuffix('/compressed').rsplit('/', 1)[0]}/camera_info"
    message = bag.message(name) if bag.types.get(name) == INFO_TYPE else None
    if message is None:
        return None

    def value(key: str) -> Any:  # ROS 1 has capitals
        found = getattr(message, key, getattr(message, key.upper(), ()))
        return np.asarray(found, float).tolist()

    content: dict[str, Any] = {key: value(key) for key in "kdrp"}
    content |= {key: getattr(message, key) for key in ("width", "height", "distortion_model", "binning_x", "binning_y")}
    region = ("x_offset", "y_offset", "width", "height")
    content["roi"] = {key: int(getattr(message.roi, key)) for key in region}
    found = camera_info(bag.path, content, where=f"{name}: ")
    projection = np.zeros((3, 4)) if found.projection is None else found.projection
    return _Info(found.raw, found.turn, projection, found.notes)


def _image(bag: BagFile, topic: str, index: Index, i: int, camera: Camera) -> Image:
    message = bag.message(topic, index.places[i])
    where = f"{bag.path}: image {i} of {topic}"
    compressed = bag.types[topic] == IMAGE_TYPES[1]
    if compressed:
        return decode(bytes(message.data), where, (camera.width, camera.height))
    image = _pixels(message, where)
    if image is None:
        raise UnreadableImage(f"{where} is not whole or of no known format: restore the bag")
    height, width = image.shape[:2]
    if (width, height) != (camera.width, camera.height):
        wanted = f"{camera.width} x {camera.height}"
        raise InputError(f"{where} is {width} x {height}, not {wanted} as its camera: correct the calibration")
    return image


def _pixels(message: Any, where: str) -> Image | None:
    if message.encoding not in ENCODINGS:
        raise InputError(f"{where} has encoding {message.encoding}, give one of {', '.join(ENCODINGS)}")
    channels, conversion = ENCODINGS[message.encoding]
    width, height, step = message.width, message.height, message.step
    if step < width * channels or len(message.data) < height * step or not width * height:
        return None
    rows = np.asarray(message.data, np.uint8)[: height * step].reshape(height, step)[:, : width * channels]
    image = np.ascontiguousarray(rows.reshape((height, width, channels) if channels > 1 else (height, width)))
    image = image if conversion is None else np.asarray(cv2.cvtColor(image, conversion), np.uint8)
    image.setflags(write=False)
    return image
