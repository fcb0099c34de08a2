"""Image topics of a ROS 1 bag, a ROS 2 bag or an MCAP file, with their camera_info: one camera or a pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.bag_file import IMAGE_TYPES, METADATA, BagFile, Index
from ispom.io.calibrations.recognised import one_rig
from ispom.io.camera import usable
from ispom.io.files import exists, is_folder
from ispom.io.mapping import read_mapping
from ispom.sequences.formats.bag_calibration import TopicInfo, baseline_m, fault_of_pair, usable_info
from ispom.sequences.formats.bag_images import TopicImages
from ispom.sequences.formats.bag_sensors import BagCamera, sensors_of_bag
from ispom.sequences.formats.bag_topics import SIDES, Infos, by_role, is_depth, is_rectified, pairs_by_baseline, rank
from ispom.sequences.formats.folder import CAMERA, read_settings
from ispom.sequences.guess import guessed
from ispom.sequences.matching import pairs, unmatched_note
from ispom.sequences.recording import Recording, Side
from ispom.sequences.rectification import remapped, undistortion
from ispom.sequences.sidecars import first_of, used
from ispom.sequences.stereo_stream import stereo_stream
from ispom.sequences.stream import Stream, size_of
from ispom.types import Found, Image

RIGS = ("camchain.yaml", "rig.yaml")
"""Names of calibration files of two cameras in the folder of a bag."""
BAG_SUFFIXES = frozenset({".bag", ".mcap", ".db3"})
Opened = tuple[Recording, BagCamera]
"""A recording, and its left camera in the bag."""


def looks_like_bag(path: Path) -> bool:
    """Checks whether a path has the name of a bag, or is the folder of a ROS 2 bag."""
    return path.suffix.lower() in BAG_SUFFIXES or (is_folder(path) and exists(path / METADATA))


def open_bag(path: Path, calibration: Path | None = None, chosen: Sequence[str] = ()) -> Recording:
    """Returns the recording of a bag's stereo pair, or else of its first camera. Raises InputError that names what is
    missing or wrong.

    `calibration` is that of a camera whose camera_info is missing, or without a calibration. `chosen` names
    the topics: left=TOPIC and right=TOPIC, or video=TOPIC. Opening reads the bag once, for the times of its images.
    """
    bag = BagFile(path)
    topics = sorted((topic for topic, kind in bag.types.items() if kind in IMAGE_TYPES), key=rank)
    if not topics:
        raise InputError(f"{path} has no image topic: give a bag with images")
    roles = by_role(bag, topics, chosen)
    topics = [topic for topic in topics if bag.holds(topic)] or topics
    infos: Infos = {topic: usable_info(bag, topic) for topic in {*topics, *roles.values()}}
    opened = _of_choice(bag, topics, infos, calibration, roles) if roles else _found(bag, topics, infos, calibration)
    return _with_others(bag, *opened)


def _with_others(bag: BagFile, recording: Recording, camera: BagCamera) -> Recording:
    """Returns the recording with the bag's other sensors and topics."""
    sensors, others = sensors_of_bag(bag, camera)
    times = Found("times", f"{bag.path.name}:{camera.topic}", why="by the bag's clock" if camera.own_clock else "")
    return replace(recording, found=(*recording.found, times, *others), sensors=sensors)


def _of_choice(
    bag: BagFile, topics: list[str], infos: Infos, calibration: Path | None, roles: dict[str, str]
) -> Opened:
    """Returns the recording of the topics that the user chose. Raises InputError for two topics that are no pair."""
    if "video" in roles:
        topic = roles["video"]
        return _single(bag, topic, infos[topic], [other for other in topics if other != topic], calibration)
    both = roles["left"], roles["right"]
    left, right = infos[both[0]], infos[both[1]]
    if isinstance(left, TopicInfo) and isinstance(right, TopicInfo):
        if fault := fault_of_pair(left, right):
            raise InputError(f"{bag.path}: {both[0]} and {both[1]} are no pair: {fault}")
        if calibration is not None:
            raise _calibrated(bag.path, calibration)
        return _pair(bag, both, (left, right))
    found = _pair_of_file(bag, topics, calibration, both)
    if found is None:
        without = both[0] if not isinstance(left, TopicInfo) else both[1]
        raise InputError(
            f"{bag.path} has no usable camera_info for {without}: give --camera with a file of both cameras, or put it "
            f"beside the bag as {' or '.join(RIGS)}"
        )
    return found


def _found(bag: BagFile, topics: list[str], infos: Infos, calibration: Path | None) -> Opened:
    """Returns the recording of the pair, or else of the first camera, by names of topics and camera_info."""
    if not any(isinstance(info, TopicInfo) for info in infos.values()):
        by_file = _pair_of_file(bag, topics, calibration)
        if by_file is not None:
            return by_file
    reasons: list[str] = []
    for left in topics:
        right = next((left.replace(*names) for names in SIDES if names[0] in left), left)
        first, second = infos[left], infos.get(right)
        if right == left or not isinstance(first, TopicInfo) or not isinstance(second, TopicInfo):
            continue
        if not (fault := fault_of_pair(first, second)):
            if calibration is not None:
                raise _calibrated(bag.path, calibration)
            return _pair(bag, (left, right), (first, second))
        reasons.append(f"{bag.path.name}: {left} and {right} are not used as a pair: {fault}")
    cameras = [topic for topic in topics if not is_depth(topic)] or topics
    by_baseline = None if reasons or calibration is not None else _pair_by_baseline(bag, cameras, infos)
    if by_baseline is not None:
        return by_baseline
    known = [topic for topic in cameras if isinstance(infos[topic], TopicInfo)]
    topic = (known if known and calibration is None else cameras)[0]
    alone, camera = _single(bag, topic, infos[topic], [other for other in topics if other != topic], calibration)
    return replace(alone, notes=(*alone.notes, *reasons[:1])), camera


def _pair_by_baseline(bag: BagFile, topics: list[str], infos: Infos) -> Opened | None:
    """Returns the pair of two topics of which one has the P of the other one, moved to the right (Tx), with any names;
    None without such a pair."""
    found = list(pairs_by_baseline(topics, infos))
    if not found:
        return None
    left, right, first, second = found[0]
    opened, camera = _pair(bag, (left, right), (first, second))
    note = f"{bag.path.name}: {left} and {right} are taken as a pair, by the baseline in their camera_info"
    if len({(one.rsplit("/", 1)[0], other.rsplit("/", 1)[0]) for one, other, _, _ in found}) > 1:
        note += "; others are pairs, too: --topics left=... right=... chooses"
    return replace(opened, notes=(note, *opened.notes)), camera


def _pair_of_file(
    bag: BagFile, topics: list[str], calibration: Path | None, chosen: tuple[str, str] | None = None
) -> Opened | None:
    """Returns the pair of a bag without calibration, by a file of two cameras; None without such a file.

    The file is `calibration`, or a camchain.yaml or rig.yaml beside the bag. The topics are the `chosen` ones, or those
    that the file names (Kalibr's rostopic), or those with the usual names of a pair. Raises InputError where the file's
    cameras are none of the topics.
    """
    path = calibration or first_of((bag.path.resolve().parent,), RIGS)
    cameras = [topic for topic in topics if not is_depth(topic)]
    if path is None or (len(cameras) < 2 and chosen is None):
        return None
    first = cameras[0] if chosen is None else chosen[0]
    try:
        rig, notes = one_rig((path,), True, lambda: TopicImages(bag, first, _index(bag, first)).first_size())
    except InputError:
        if calibration is None and chosen is None:
            return None
        raise
    if not rig.has_stereo:
        return None
    both = chosen or _topics_of_file(bag, path, cameras)
    streams, clocks = [], []
    for topic, side in zip(both, ("left", "right"), strict=True):
        index = _index(bag, str(topic))
        clocks.append(index.own_clock)
        images = TopicImages(bag, str(topic), index, size_of(rig.camera(side)))
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


def _topics_of_file(bag: BagFile, path: Path, cameras: list[str]) -> tuple[str, str]:
    content = read_mapping(path) if path.suffix.lower() in (".yaml", ".yml") else {}
    named = [content.get(f"cam{i}") for i in (0, 1)]
    both = [each.get("rostopic") if isinstance(each, dict) else None for each in named]
    if not all(topic in cameras for topic in both):
        pairs_called = [(one, one.replace(*side)) for side in SIDES for one in cameras if side[0] in one]
        both = next(([one, other] for one, other in pairs_called if other in cameras and other != one), [])
    if len(both) != 2:
        raise InputError(
            f"{path} has two cameras, and none of the topics of {bag.path} are known as theirs ({', '.join(cameras)}): "
            "write rostopic in it, as Kalibr does, or name them by --topics left=... right=..."
        )
    return str(both[0]), str(both[1])


def _calibrated(path: Path, calibration: Path) -> InputError:
    return InputError(f"{path} has its own calibration: leave --camera {calibration} out")


def _single(
    bag: BagFile, topic: str, info: TopicInfo | InputError | None, others: list[str], calibration: Path | None
) -> Opened:
    default_camera = bag.path.resolve().parent / CAMERA
    index, guess = _index(bag, topic), None
    notes = (f"Of {bag.path.name} only {topic} is used, not {', '.join(others)}.",) if others else ()
    notes += _notes(bag, index)
    images = TopicImages(bag, topic, index)
    found, raw = used(("lens", calibration or default_camera)), BagCamera(topic, own_clock=index.own_clock)
    if isinstance(info, TopicInfo):
        if calibration is not None:
            raise _calibrated(bag.path, calibration)
        camera, found = info.raw, (Found("lens", f"{bag.path.name}:{info.topic}"),)
        if is_rectified(topic):
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
    images = TopicImages(bag, topic, index, (camera.width, camera.height))
    name, times_ns = f"bag {bag.path.name}", index.stamps_ns
    recording = Recording(
        name, camera, None, times_ns, lambda _, i: images.read(i), None, notes, guess=guess, found=found
    )
    return recording, raw


def _notes(bag: BagFile, *indices: Index) -> tuple[str, ...]:
    return tuple(f"{bag.path.name}: {note}" for index in indices for note in index.notes)


def _pair(bag: BagFile, topics: tuple[str, str], infos: tuple[TopicInfo, TopicInfo]) -> Opened:
    left, right = _indices(bag, topics)
    i_left, i_right = pairs(left.stamps_ns, right.stamps_ns)
    if not len(i_left):
        raise InputError(f"{bag.path}: no images of {' and '.join(topics)} are of the same time: record both together")
    camera = usable(infos[0].rectified, f"{bag.path}: P of {topics[0]}")
    size = (camera.width, camera.height)
    maps = [undistortion(info.raw, info.turn, info.projection, size) for info in infos]
    raws = [
        TopicImages(bag, topic, index, (info.raw.width, info.raw.height))
        for topic, index, info in zip(topics, (left, right), infos, strict=True)
    ]
    streams = {"left": (0, i_left), "right": (1, i_right)}

    def read(side: Side, i: int) -> Image:
        k, matched = streams[side]
        image = raws[k].read(int(matched[i]))
        return image if is_rectified(topics[k]) or infos[k].is_straight else remapped(image, maps[k])

    notes = infos[0].notes + infos[1].notes + _notes(bag, left, right)
    notes += unmatched_note(len(left.places), len(right.places), len(i_left))
    lens = tuple(Found("lens", f"{bag.path.name}:{info.topic}") for info in infos)
    times_ns, name = left.stamps_ns[i_left], f"bag {bag.path.name}"
    recording = Recording(name, camera, baseline_m(*infos), times_ns, read, None, notes, found=lens)
    return recording, BagCamera(topics[0], Pose(infos[0].turn), left.own_clock)


def _index(bag: BagFile, topic: str) -> Index:
    index = bag.index(topic)
    if not index.places:
        raise InputError(f"{bag.path}: {topic} holds no image: give a bag with images")
    return index


def _indices(bag: BagFile, topics: tuple[str, str]) -> tuple[Index, Index]:
    """Returns the indices of a pair's topics by one clock: if stamps repeat, by the clock that gives more pairs."""
    left, right = _index(bag, topics[0]), _index(bag, topics[1])
    if not (left.own_clock or right.own_clock):
        return left, right
    tried = [(bag.index(topics[0], own_clock), bag.index(topics[1], own_clock)) for own_clock in (True, False)]
    return max(tried, key=lambda both: len(pairs(both[0].stamps_ns, both[1].stamps_ns)[0]))
