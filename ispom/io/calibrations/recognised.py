"""Reads calibrations of all known formats, recognised by their content."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations import dialects
from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import CalibrationFile
from ispom.io.calibrations.dialects import ispom_rig
from ispom.io.calibrations.pair import pair_fault, unit_note
from ispom.io.calibrations.placed import Placed
from ispom.io.files import exists, is_folder, names
from ispom.io.mapping import read_mapping
from ispom.types import Camera, Rig

SUFFIXES = (".yaml", ".yml", ".xml", ".json", ".conf", ".edex", ".cameramodel")
"""Suffixes of the calibration files that a folder is searched for."""
_COLMAP = ("cameras.bin", "cameras.txt")
_ALIASES = {"cam0": "left", "cam1": "right", "cam2": "video", "mono": "video"}
_ORDER = {1: ("video",), 2: ("left", "right"), 3: ("left", "right", "video")}


def one_camera(path: Path, size: ImageSize | None = None) -> tuple[Camera, dict[Any, Any], tuple[str, ...]]:
    """Reads the one camera of a file, with all entries of the file, and notes about what is skipped or likely wrong.

    `size` is that of the images, used where the file has none.
    """
    found = _read(_file_of(path), size)
    if len(found.cameras) == 1:
        return found.cameras[0].camera, found.entries, found.cameras[0].notes
    usual = [each for each in found.cameras if each.name == found.usual]
    if not usual:
        called = ", ".join(each.name for each in found.cameras)
        several = f"holds {len(found.cameras)} cameras ({called})" if called else "holds no camera"
        raise InputError(f"{path} {several}: give the file of one camera")
    others = ", ".join(each.name for each in found.cameras if each.name != found.usual)
    note = f"{path}: of its cameras that called {found.usual} here is used, not {others}"
    return usual[0].camera, found.entries, (*usual[0].notes, note)


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


def _file_of(path: Path) -> Path:
    """Returns the file with COLMAP's cameras in a folder; any other path unchanged."""
    if not is_folder(path):
        return path
    return next((path / name for name in _COLMAP if exists(path / name)), path)


def _files(path: Path) -> tuple[Path, ...]:
    path = _file_of(path)
    if not is_folder(path):
        return (path,)
    inside = [path / name for name in names(path)]
    sensors = [each / "sensor.yaml" for each in inside if is_folder(each) and exists(each / "sensor.yaml")]
    sensors = [sensor for sensor in sensors if _is_of_camera(sensor)]
    files = sensors or [each for each in inside if each.suffix.lower() in SUFFIXES]
    if not files:
        raise InputError(f"{path} holds no calibration: no sensor.yaml, COLMAP's cameras, nor {', '.join(SUFFIXES)}")
    return tuple(files)


def _is_of_camera(path: Path) -> bool:
    """Checks that a sensor.yaml is that of a camera: EuRoC's IMU has one, too."""
    return "intrinsics" in read_mapping(path)


def _read(path: Path, size: ImageSize | None = None, every_placed: bool = True) -> CalibrationFile:
    """Reads a file by the dialect that its content has."""
    content = Content.of(path)
    if not every_placed and dialects.recognised(content) is ispom_rig.DIALECT:
        return ispom_rig.read_placed(content, False)
    return dialects.read(content, size)
