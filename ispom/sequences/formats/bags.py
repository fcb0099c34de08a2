"""Image topics of a ROS 1 bag, a ROS 2 bag or an MCAP file, with their camera_info: one camera or a pair."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError, UnreadableImage
from ispom.geometry import Array, Pose
from ispom.io.bag_file import IMAGE_TYPES, INFO_TYPE, METADATA, BagFile, Index
from ispom.io.calibrations.camera_info import camera_info
from ispom.io.calibrations.pair import pair_fault
from ispom.io.calibrations.recognised import one_rig
from ispom.io.camera import usable
from ispom.io.files import exists, is_folder
from ispom.io.mapping import read_mapping
from ispom.sequences.formats.bag_sensors import BagCamera, sensors_of_bag
from ispom.sequences.formats.folder import CAMERA, read_settings
from ispom.sequences.guess import guessed
from ispom.sequences.images import as_bytes, decode, sampled, span_of_values, values_of
from ispom.sequences.matching import pairs, unmatched_note
from ispom.sequences.recording import Recording, Side
from ispom.sequences.rectification import remapped, undistortion
from ispom.sequences.sidecars import first_of, used
from ispom.sequences.stereo_stream import stereo_stream
from ispom.sequences.stream import Stream, size_of
from ispom.types import Camera, Found, Image

RIGS = ("camchain.yaml", "rig.yaml")
"""Files of two cameras beside a bag."""
BAG_SUFFIXES = frozenset({".bag", ".mcap", ".db3"})
SIDES = (
    ("left", "right"),
    ("cam0", "cam1"),
    ("camera0", "camera1"),
    ("infra1", "infra2"),
    ("Infrared_1", "Infrared_2"),
)
"""How topics of a pair are called."""
_BAYER = {
    "rggb": cv2.COLOR_BayerRGGB2RGB,
    "bggr": cv2.COLOR_BayerBGGR2RGB,
    "gbrg": cv2.COLOR_BayerGBRG2RGB,
    "grbg": cv2.COLOR_BayerGRBG2RGB,
}
_COLOURS = {
    "rgb": (3, None),
    "bgr": (3, cv2.COLOR_BGR2RGB),
    "rgba": (4, cv2.COLOR_RGBA2RGB),
    "bgra": (4, cv2.COLOR_BGRA2RGB),
}
ENCODINGS: dict[str, tuple[type[np.generic], int, int | None]] = {
    "mono8": (np.uint8, 1, None),
    "mono16": (np.uint16, 1, None),
    **{f"{name}8": (np.uint8, *how) for name, how in _COLOURS.items()},
    **{f"{name}16": (np.uint16, *how) for name, how in _COLOURS.items()},
    **{f"bayer_{name}8": (np.uint8, 1, how) for name, how in _BAYER.items()},
    **{f"bayer_{name}16": (np.uint16, 1, how) for name, how in _BAYER.items()},
    "8UC1": (np.uint8, 1, None),
    "8UC3": (np.uint8, 3, cv2.COLOR_BGR2RGB),
    "8UC4": (np.uint8, 4, cv2.COLOR_BGRA2RGB),
    "16UC1": (np.uint16, 1, None),
    "16SC1": (np.int16, 1, None),
    "16UC3": (np.uint16, 3, cv2.COLOR_BGR2RGB),
    "16UC4": (np.uint16, 4, cv2.COLOR_BGRA2RGB),
    "32FC1": (np.float32, 1, None),
    "32FC3": (np.float32, 3, cv2.COLOR_BGR2RGB),
    "yuv422": (np.uint8, 2, cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": (np.uint8, 2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": (np.uint8, 2, cv2.COLOR_YUV2RGB_YUY2),
    "yuyv": (np.uint8, 2, cv2.COLOR_YUV2RGB_YUY2),
}
"""Kind and number of values per pixel, and what makes RGB of them where they are bytes."""


FIRST = 10
"""Images of which one must be readable."""


@dataclass(frozen=True, eq=False)
class _Info:
    """A camera_info: the raw camera, and how it is rectified."""

    raw: Camera
    turn: Array
    """(3, 3) rectified_from_raw."""
    projection: Array
    """(3, 4) of the rectified image; all zero where the camera was not calibrated."""
    topic: str = ""
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


def open_bag(path: Path, calibration: Path | None = None) -> Recording:
    """The recording of a bag's stereo pair, or else of its first camera; InputError names what is missing or wrong.

    `calibration` is that of a camera whose camera_info is missing, or says that it is not calibrated. Opening reads the
    bag once, for the times of its images.
    """
    bag = BagFile(path)
    topics = sorted((topic for topic, kind in bag.types.items() if kind in IMAGE_TYPES), key=_rank)
    if not topics:
        raise InputError(f"{path} has no image topic: give a bag with images")
    topics = [topic for topic in topics if bag.holds(topic)] or topics
    infos, reasons = {topic: _usable_info(bag, topic) for topic in topics}, []
    if not any(isinstance(info, _Info) for info in infos.values()):
        by_file = _pair_of_file(bag, topics, calibration)
        if by_file is not None:
            return _with_others(bag, *by_file)
    for left in topics:
        right = next((left.replace(*names) for names in SIDES if names[0] in left), left)
        first, second = infos[left], infos.get(right)
        if right == left or not isinstance(first, _Info) or not isinstance(second, _Info):
            continue
        if not (fault := _pair_fault(first, second)):
            if calibration is not None:
                raise _calibrated(path, calibration)
            return _with_others(bag, *_pair(bag, (left, right), (first, second)))
        reasons.append(f"{path.name}: {left} and {right} are not used as a pair: {fault}")
    cameras = [topic for topic in topics if not _is_depth(topic)] or topics
    by_baseline = None if reasons or calibration is not None else _pair_by_baseline(bag, cameras, infos)
    if by_baseline is not None:
        return _with_others(bag, *by_baseline)
    known = [topic for topic in cameras if isinstance(infos[topic], _Info)]
    topic = (known if known and calibration is None else cameras)[0]
    alone, camera = _single(bag, topic, infos[topic], [other for other in topics if other != topic], calibration)
    return _with_others(bag, replace(alone, notes=(*alone.notes, *reasons[:1])), camera)


def _with_others(bag: BagFile, recording: Recording, camera: BagCamera) -> Recording:
    """The recording with what else the bag holds."""
    sensors, others = sensors_of_bag(bag, camera)
    times = Found("times", f"{bag.path.name}:{camera.topic}", why="by the bag's clock" if camera.own_clock else "")
    return replace(recording, found=(*recording.found, times, *others), sensors=sensors)


def _pair_by_baseline(
    bag: BagFile, topics: list[str], infos: dict[str, _Info | InputError | None]
) -> tuple[Recording, BagCamera] | None:
    """The pair of two topics of one name in different places, known by a P that is that of the other one moved to the
    right (Tx); None where there is none."""
    for left in topics:
        for right in topics:
            first, second = infos[left], infos[right]
            same = left.rsplit("/", 1)[-1] == right.rsplit("/", 1)[-1] and left != right
            if same and isinstance(first, _Info) and isinstance(second, _Info) and not _pair_fault(first, second):
                found, camera = _pair(bag, (left, right), (first, second))
                note = f"{bag.path.name}: {left} and {right} are taken as a pair, by the baseline in their camera_info"
                return replace(found, notes=(note, *found.notes)), camera
    return None


def _pair_of_file(bag: BagFile, topics: list[str], calibration: Path | None) -> tuple[Recording, BagCamera] | None:
    """The pair of a bag without calibration, by a file of two cameras: `calibration`, or a camchain.yaml or rig.yaml
    beside the bag, whose topics are those that it names (Kalibr's rostopic), or those that are called as pairs are.
    None where there is no such file. Raises InputError where its cameras are none of the topics."""
    path = calibration or first_of((bag.path.resolve().parent,), RIGS)
    cameras = [topic for topic in topics if not _is_depth(topic)]
    if path is None or len(cameras) < 2:
        return None
    try:
        rig, notes = one_rig((path,), True, lambda: _Images(bag, cameras[0], _index(bag, cameras[0])).first_size())
    except InputError:
        if calibration is None:
            return None
        raise
    if not rig.has_stereo:
        return None
    content = read_mapping(path) if path.suffix.lower() in (".yaml", ".yml") else {}
    named = [content.get(f"cam{i}") for i in (0, 1)]
    both = [each.get("rostopic") if isinstance(each, dict) else None for each in named]
    if not all(topic in topics for topic in both):
        pairs_called = [(one, one.replace(*side)) for side in SIDES for one in cameras if side[0] in one]
        both = next(([one, other] for one, other in pairs_called if other in cameras and other != one), [])
    if len(both) != 2:
        raise InputError(
            f"{path} has two cameras, and none of the topics of {bag.path} are known as theirs ({', '.join(cameras)}): "
            "write rostopic in it, as Kalibr does"
        )
    streams, clocks = [], []
    for topic, side in zip(both, ("left", "right"), strict=True):
        index = _index(bag, str(topic))
        clocks.append(index.own_clock)
        images = _Images(bag, str(topic), index, size_of(rig.camera(side)))
        streams.append(Stream(index.stamps_ns, images.read, _notes(bag, index)))
    stereo = stereo_stream(bag.path, rig, *streams)
    note = f"{bag.path.name}: {both[0]} and {both[1]} are the pair of {path}"
    recording = Recording(
        f"bag {bag.path.name}", stereo.rig.camera("left"), stereo.rig.baseline_m, stereo.times_ns, stereo.read, None,
        (note, *notes, *stereo.notes), video_sigma=stereo.rig.video_sigma, pair_sigma=stereo.rig.pair_sigma,
        found=used(("lens", path)),
    )  # fmt: skip
    left_from_raw = stereo.rig.rig_from_left.inverse() @ rig.rig_from_left
    return recording, BagCamera(str(both[0]), left_from_raw, clocks[0])


def _calibrated(path: Path, calibration: Path) -> InputError:
    return InputError(f"{path} has its own calibration: leave --camera {calibration} out")


def _usable_info(bag: BagFile, topic: str) -> _Info | InputError | None:
    """The topic's camera_info, or why it cannot be used; None where there is none, or it says nothing."""
    try:
        return _info(bag, topic)
    except InputError as fault:
        return fault


def _single(
    bag: BagFile, topic: str, info: _Info | InputError | None, others: list[str], calibration: Path | None
) -> tuple[Recording, BagCamera]:
    default_camera = bag.path.resolve().parent / CAMERA
    index, guess = _index(bag, topic), None
    notes = (f"Of {bag.path.name} only {topic} is used, not {', '.join(others)}.",) if others else ()
    notes += _notes(bag, index)
    images = _Images(bag, topic, index)
    found, raw = used(("lens", calibration or default_camera)), BagCamera(topic, own_clock=index.own_clock)
    if isinstance(info, _Info):
        if calibration is not None:
            raise _calibrated(bag.path, calibration)
        camera, found = info.raw, (Found("lens", f"{bag.path.name}:{info.topic}"),)
        if _is_rectified(topic):
            camera = usable(info.rectified, f"{bag.path}: P of {topic}")
            raw = replace(raw, left_from_raw=Pose(info.turn))
        notes = info.notes + notes
    elif calibration is not None or exists(default_camera):
        camera, _, unknown = read_settings(calibration or default_camera, images.first_size)
        notes += unknown
    elif info is not None:
        raise InputError(f"{info.args[0]}, or give --camera")
    else:
        size = images.first_size()
        guess, found = guessed(size, None), ()
        camera = guess.camera(size)
        notes += (f"{bag.path.name} has no calibration for {topic}: give --camera, or write {default_camera}",)
    images = _Images(bag, topic, index, (camera.width, camera.height))
    times_ns = index.stamps_ns
    return Recording(
        f"bag {bag.path.name}",
        camera,
        None,
        times_ns,
        lambda _, i: images.read(i),
        None,
        notes,
        guess=guess,
        found=found,
    ), raw


def _notes(bag: BagFile, *indices: Index) -> tuple[str, ...]:
    return tuple(f"{bag.path.name}: {note}" for index in indices for note in index.notes)


def _pair(bag: BagFile, topics: tuple[str, str], infos: tuple[_Info, _Info]) -> tuple[Recording, BagCamera]:
    left, right = _indices(bag, topics)
    i_left, i_right = pairs(left.stamps_ns, right.stamps_ns)
    if not len(i_left):
        raise InputError(f"{bag.path}: no images of {' and '.join(topics)} are of the same time: record both together")
    camera = usable(infos[0].rectified, f"{bag.path}: P of {topics[0]}")
    size = (camera.width, camera.height)
    maps = [undistortion(info.raw, info.turn, info.projection, size) for info in infos]
    raws = [
        _Images(bag, topic, index, (info.raw.width, info.raw.height))
        for topic, index, info in zip(topics, (left, right), infos, strict=True)
    ]
    streams = {"left": (0, i_left), "right": (1, i_right)}

    def read(side: Side, i: int) -> Image:
        k, matched = streams[side]
        image = raws[k].read(int(matched[i]))
        return image if _is_rectified(topics[k]) or infos[k].is_straight else remapped(image, maps[k])

    notes = infos[0].notes + infos[1].notes + _notes(bag, left, right)
    notes += unmatched_note(len(left.places), len(right.places), len(i_left))
    baseline_m = _baseline_m(*infos)
    lens = tuple(Found("lens", f"{bag.path.name}:{info.topic}") for info in infos)
    times_ns, name = left.stamps_ns[i_left], f"bag {bag.path.name}"
    recording = Recording(name, camera, baseline_m, times_ns, read, None, notes, found=lens)
    return recording, BagCamera(topics[0], Pose(infos[0].turn), left.own_clock)


def _rank(topic: str) -> tuple[bool, bool, bool, str]:
    """Cameras before depth images, rectified before raw, as they are before compressed."""
    return _is_depth(topic), not _is_rectified(topic), topic.endswith("/compressed"), topic


def _is_depth(topic: str) -> bool:
    return "depth" in topic.lower()


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


def _index(bag: BagFile, topic: str) -> Index:
    index = bag.index(topic)
    if not index.places:
        raise InputError(f"{bag.path}: {topic} holds no image: give a bag with images")
    return index


def _indices(bag: BagFile, topics: tuple[str, str]) -> tuple[Index, Index]:
    """Of a pair, both by one clock: where stamps repeat, by that which makes more pairs."""
    left, right = _index(bag, topics[0]), _index(bag, topics[1])
    if not (left.own_clock or right.own_clock):
        return left, right
    tried = [(bag.index(topics[0], own_clock), bag.index(topics[1], own_clock)) for own_clock in (True, False)]
    return max(tried, key=lambda both: len(pairs(both[0].stamps_ns, both[1].stamps_ns)[0]))


def _info(bag: BagFile, topic: str) -> _Info | None:
    """InputError where it is of no camera that can be used; None where there is none, or it says nothing."""
    place = topic.removesuffix("/compressed").rsplit("/", 1)[0]
    name = next((name for name in _info_names(place) if bag.types.get(name) == INFO_TYPE), "")
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
    return _Info(info.raw, info.turn, projection, name, info.notes)


def _info_names(place: str) -> tuple[str, str]:
    """Where the camera_info of a topic in this place is: beside it, or as RealSense's recorder has it."""
    return f"{place}/camera_info", f"{place.removesuffix('/image')}/info/camera_info"


class _Images:
    """The images of one topic, decoded when requested."""

    def __init__(self, bag: BagFile, topic: str, index: Index, size: tuple[int, int] | None = None) -> None:
        """Of this size (width, height) where it is known."""
        self._bag, self._topic, self._index, self._size = bag, topic, index, size
        self._compressed = bag.types[topic] == IMAGE_TYPES[1]

    def read(self, i: int) -> Image:
        """Image i, grey or RGB; InputError where it is unreadable, of an unknown encoding, or of another size."""
        where, message = self._where(i), self._bag.message(self._topic, self._index.places[i])
        if self._compressed:
            return decode(bytes(message.data), where, self._size, span=lambda: self._span)
        values = _values(message, where)
        height, width = values.shape[:2]
        if self._size is not None and (width, height) != self._size:
            expected = f"{self._size[0]} x {self._size[1]}"
            raise InputError(f"{where} is {width} x {height}, not {expected} as its camera: correct the calibration")
        if values.dtype != np.uint8:
            values = as_bytes(values, self._span)
        conversion = ENCODINGS[message.encoding][2]
        image = values if conversion is None else np.asarray(cv2.cvtColor(values, conversion), np.uint8)
        image = np.ascontiguousarray(image)
        image.setflags(write=False)
        return image

    def first_size(self) -> tuple[int, int]:
        """(width, height) of the first image that can be read."""
        fault = None
        for i in range(min(len(self._index.places), FIRST)):
            try:
                return self.read(i).shape[1::-1]
            except UnreadableImage as error:
                fault = fault or error
        raise fault or InputError(f"{self._bag.path}: {self._topic} holds no image: give a bag with images")

    @cached_property
    def _span(self) -> tuple[float, float]:
        """What is black and white in all images of the topic."""
        spans = []
        for i in sampled(len(self._index.places)):
            message = self._bag.message(self._topic, self._index.places[i])
            try:
                of = values_of if self._compressed else _values
                values = of(bytes(message.data) if self._compressed else message, self._where(i))
            except InputError:
                continue
            if values is not None:
                spans.append(values[np.isfinite(values)])
        return span_of_values(spans)

    def _where(self, i: int) -> str:
        return f"{self._bag.path}: image {i} of {self._topic}"


def _values(message: Any, where: str) -> NDArray[Any]:
    """(H, W) or (H, W, C) as the message has them; UnreadableImage where it is not whole."""
    if message.encoding not in ENCODINGS:
        raise InputError(f"{where} has encoding {message.encoding}, give one of {', '.join(ENCODINGS)}")
    kind, channels, conversion = ENCODINGS[message.encoding]
    width, height, step = message.width, message.height, message.step
    kind = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    wide = width * channels * kind.itemsize
    if step < wide or len(message.data) < height * step or not width * height:
        raise UnreadableImage(f"{where} is not whole: restore the bag")
    if (channels == 2 and width % 2) or (conversion in _BAYER.values() and min(width, height) < 2):
        raise UnreadableImage(
            f"{where} has {width} x {height} px, which {message.encoding} cannot have: restore the bag"
        )
    rows = np.asarray(message.data, np.uint8)[: height * step].reshape(height, step)[:, :wide]
    values = np.ascontiguousarray(rows).view(kind)
    return values.reshape((height, width, channels) if channels > 1 else (height, width)).astype(kind.newbyteorder("="))
