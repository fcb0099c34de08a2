"""Reads calibrations of all known formats, recognised by their content."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations.camera_info import ImageSize, matrix_key
from ispom.io.calibrations.files import placed_of
from ispom.io.calibrations.kalibr import is_camera, read_euroc_sensor, read_kalibr
from ispom.io.calibrations.opencv import is_xml, read_extrinsics, read_opencv
from ispom.io.calibrations.pair import pair_fault, unit_note
from ispom.io.calibrations.placed import Placed, placed
from ispom.io.camera import INTRINSICS, SIZES, camera_of, skipped_note
from ispom.io.colmap import read_colmap_cameras
from ispom.io.files import exists, is_folder, names
from ispom.io.mapping import MAX_BYTES, read_mapping
from ispom.io.rig import ENTRIES, read_rig
from ispom.io.rows import read_text
from ispom.io.values import CAMERAS
from ispom.plausibility.mounts import order_doubts
from ispom.types import Camera, Rig

KNOWN = (
    "rig.yaml, camera.yaml, Kalibr's camchain, EuRoC's sensor.yaml, OpenCV's YAML, XML or JSON, ROS's camera_info, or "
    "COLMAP's cameras.txt"
)
SUFFIXES = (".yaml", ".yml", ".xml", ".json")
"""Largest number of files that are examined in a folder."""
_ALIASES = {"cam0": "left", "cam1": "right", "cam2": "video", "mono": "video"}
_ORDER = {1: ("video",), 2: ("left", "right"), 3: ("left", "right", "video")}


@dataclass(frozen=True, eq=False)
class CalibrationFile:
    """The content of one file."""

    path: Path
    cameras: list[Placed]
    rig: Rig | None = None
    """The content of a rig.yaml."""
    second: Pose | None = None
    """first_from_second of a pair, where the file has nothing else."""
    is_relative: bool = False
    """The poses are those of one camera in another, not on a body that the file defines."""
    of_pair: bool = False
    """The poses are valid for a left and a right camera only: ROS's camera_info has any other at 0."""
    entries: dict[Any, Any] = field(default_factory=dict)
    """All entries, also those that are not of the camera, such as the rate of its images; empty for several cameras."""


def one_camera(path: Path, size: ImageSize | None = None) -> tuple[Camera, dict[Any, Any], tuple[str, ...]]:
    """Reads the one camera of a file, with all entries of the file, and notes about what is skipped or likely wrong.

    `size` is that of the images, used where the file has none.
    """
    camera = _read(path, size)
    if len(camera.cameras) != 1:
        raise InputError(f"{path} holds {len(camera.cameras)} cameras: give the file of one camera")
    return camera.cameras[0].camera, camera.entries, camera.cameras[0].notes


def one_rig(
    paths: tuple[Path, ...], every_placed: bool = True, size: ImageSize | None = None
) -> tuple[Rig, tuple[str, ...]]:
    """Reads the rig of one file, or of files of one camera each, with notes about what is skipped or likely wrong.

    A folder holds such files, or folders with sensor.yaml. Cameras have the names of the files, else left, right and
    video in this order; a single one is video. Unless `every_placed`, the video camera of a rig.yaml may be without a
    pose: it is then that of the rig. Raises InputError where a file is of no known format, several cameras have no
    poses, or left and right are exchanged.
    """
    readings = [_read(file, size, every_placed) for path in paths for file in _files(path)]
    cameras = [each for file in readings for each in file.cameras]
    if not cameras:
        raise InputError(f"{paths[0]} has the places of cameras only: give it together with the file of their lenses")
    called = _names(paths[0], cameras)
    cameras = _placed(paths[0], readings, dict(zip(called, cameras, strict=True)))
    fields: dict[str, object] = {}
    for name, each in zip(called, cameras, strict=True):
        fields |= {name: each.camera, f"rig_from_{name}": each.pose}
    rig = Rig.of(**fields)  # type: ignore[arg-type]
    for file in readings:
        rig = rig if file.rig is None else rig.with_others_of(file.rig)
    notes = tuple(dict.fromkeys(note for each in cameras for note in each.notes))
    return rig, (*notes, *_pair_notes(paths[0], rig, notes))


def _pair_notes(path: Path, rig: Rig, others: tuple[str, ...]) -> tuple[str, ...]:
    """Returns notes about the baseline of a pair. Raises InputError, with the `others` that may be the reason, where
    left and right are exchanged."""
    if not rig.has_stereo:
        return ()
    between = rig.rig_from_left.inverse() @ rig.rig_from_right
    fault = pair_fault(between)
    if fault.startswith(("both", "the cameras are exchanged")):
        reasons = "".join(f" ({note})" for note in others)
        raise InputError(f"{path}: {fault}: correct the calibration{reasons}")
    unit = unit_note(float((between.translation @ between.translation) ** 0.5))
    return tuple(f"{path}: {text}" for text in (fault, unit) if text)


def _placed(path: Path, found: list[CalibrationFile], by_name: dict[str, Placed]) -> list[Placed]:
    """Returns the cameras with their poses. Raises InputError where those of several are not known."""
    cameras = list(by_name.values())
    if len(cameras) == 1:
        single = cameras[0]
        return [single.at(Pose()) if single.body_from_camera is None or found[0].is_relative else single]
    if any(file.of_pair for file in found) and set(by_name) != {"left", "right"}:
        cameras = [each.at(None) for each in cameras]
    second = next((file.second for file in found if file.second is not None), None)
    if second is not None and len(cameras) == 2:
        cameras = [cameras[0].at(Pose()), cameras[1].at(second)]
    lost = [name for name, each in zip(by_name, cameras, strict=True) if each.body_from_camera is None]
    if lost:
        raise InputError(
            f"{path} holds {len(cameras)} cameras without their poses ({', '.join(lost)}): add them (for OpenCV R and "
            "T), give a format with poses, such as Kalibr's, or one camera"
        )
    if all(file.is_relative for file in found):
        first = by_name.get("left", cameras[0]).pose.inverse() if second is None else Pose()
        cameras = [each.at(first @ each.pose) for each in cameras]
    return cameras


def _names(path: Path, found: list[Placed]) -> tuple[str, ...]:
    own = [_role(each.name) for each in found]
    if len(own) > 1 and len(set(own)) == len(own) and set(own) <= {"left", "right", "video"}:
        return tuple(own)
    if len(found) not in _ORDER:
        raise InputError(f"{path} holds {len(found)} cameras: give one, a pair, or a pair and a video camera")
    return _ORDER[len(found)]


def _role(name: str) -> str:
    """Returns left, right or video for names such as narrow_stereo/left, left_camera or cam0."""
    word = name.lower().rsplit("/", 1)[-1]
    sides = {side for side in ("left", "right") if side in re.split(r"[^a-z]+", word)}
    return sides.pop() if len(sides) == 1 else _ALIASES.get(word, word)


def _files(path: Path) -> tuple[Path, ...]:
    if not is_folder(path):
        return (path,)
    inside = [path / name for name in names(path)]
    sensors = [each / "sensor.yaml" for each in inside if is_folder(each) and exists(each / "sensor.yaml")]
    sensors = [sensor for sensor in sensors if _is_of_camera(sensor)]
    files = sensors or [each for each in inside if each.suffix.lower() in SUFFIXES]
    if not files:
        raise InputError(f"{path} holds no calibration: give a file such as {KNOWN}")
    return tuple(files)


def _is_of_camera(path: Path) -> bool:
    """EuRoC's IMU has a sensor.yaml, too."""
    return "intrinsics" in read_mapping(path)


def _read(path: Path, size: ImageSize | None = None, every_placed: bool = True) -> CalibrationFile:
    """Reads a file by the format that its entries show."""
    text, suffix = read_text(path, MAX_BYTES), path.suffix.lower()
    unknown = InputError(f"{path} is no calibration that is known: give {KNOWN}")
    if suffix == ".txt":
        cameras = [placed(path, "", path.stem, camera, None) for camera in read_colmap_cameras(path)]
        return CalibrationFile(path, cameras)
    if is_xml(text):
        return _of_opencv(path, size)
    try:
        content = read_mapping(path)
    except InputError:
        if suffix in SUFFIXES:
            raise
        raise unknown from None
    keys = {key for key in content if isinstance(key, str)}
    if keys & set(CAMERAS) or (keys and keys <= ENTRIES):
        rig = read_rig(path, every_placed)
        cameras = [
            placed(path, p.name, p.name, p.camera, p.pose, order_doubts(str(path), p.name, p.pose))
            for p in placed_of(rig)
        ]
        return CalibrationFile(path, cameras, rig)
    if any(map(is_camera, keys)):
        return CalibrationFile(path, read_kalibr(path))
    if "T_BS" in keys:
        return CalibrationFile(path, [read_euroc_sensor(path)], entries=content)
    if matrix_key(content) or matrix_key(content, "1") or {"R", "T"} <= keys or "opencv-matrix" in text:
        return replace(_of_opencv(path, size), entries=content)
    if keys & {"model", *SIZES, *INTRINSICS}:
        if size is not None and not set(SIZES) & keys:
            content = content | dict(zip(SIZES, size(), strict=True))
        camera = placed(path, "", path.stem, camera_of(path, content), None, skipped_note(path, content))
        return CalibrationFile(path, [camera], entries=content)
    raise unknown


def _of_opencv(path: Path, size: ImageSize | None) -> CalibrationFile:
    second = read_extrinsics(path)
    cameras = [] if second is not None else read_opencv(path, size)
    of_pair = len(cameras) == 1 and cameras[0].body_from_camera is not None
    return CalibrationFile(path, cameras, second=second, is_relative=True, of_pair=of_pair)
