"""EuRoC: a folder `mav0` with cam0, cam1 and state_groundtruth_estimate0; raw stereo images, rectified here.

The right camera (cam1) and the truth may be missing. Lenses may be fisheyes, as in TUM-VI, whose truth is in mocap0.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations.kalibr import read_euroc_sensor
from ispom.io.calibrations.pair import pair_fault
from ispom.io.files import exists, is_folder, names
from ispom.io.rows import read_text
from ispom.io.trajectories import read_euroc
from ispom.io.values import nanoseconds
from ispom.sequences.images import read_grey, require_size, those_there
from ispom.sequences.matching import pairs, truth_at, unmatched_note
from ispom.sequences.recording import Recording, Side
from ispom.sequences.rectification import Rectification, remapped
from ispom.sequences.sensors_beside import EUROC_IMU, euroc_imu
from ispom.types import Camera, Found, Image, Trajectory

TRUTHS = ("state_groundtruth_estimate0", "mocap0")
"""Folders of the body's poses in EuRoC and in TUM-VI."""


@dataclass(frozen=True, eq=False)
class _Sensor:
    """One camera's folder: its calibration and its list of images."""

    camera: Camera
    body_from_camera: Pose
    times_ns: NDArray[np.int64]
    paths: list[Path]
    notes: tuple[str, ...]


def looks_like_euroc(folder: Path) -> bool:
    """Checks whether a folder is a `mav0`, or contains one."""
    return is_folder(folder / "mav0") or exists(folder / "cam0" / "data.csv")


def open_euroc(folder: Path) -> Recording:
    """Returns the recording of a `mav0`, or of the folder that holds it. Raises InputError that names the missing or
    invalid file."""
    mav0 = folder / "mav0" if is_folder(folder / "mav0") else folder
    name = f"EuRoC {mav0.resolve().parent.name}"
    left = _sensor(mav0 / "cam0")
    if not is_folder(mav0 / "cam1"):
        truth, about = _truth(mav0, left.body_from_camera, left.times_ns)
        size, notes = (left.camera.width, left.camera.height), left.notes

        def read_left(_: Side, i: int) -> Image:
            return read_grey(left.paths[i], size)

        found = _found(mav0, ("cam0",), about)
        imu = euroc_imu(mav0, Pose(), left.body_from_camera.inverse())
        return Recording(name, left.camera, None, left.times_ns, read_left, truth, notes, found=found, sensors=imu)
    right = _sensor(mav0 / "cam1")
    i_left, i_right = pairs(left.times_ns, right.times_ns)
    if not len(i_left):
        raise InputError(f"{mav0 / 'cam1' / 'data.csv'} has no image of the same time as one of cam0: restore it")
    rectified = _rectification(mav0, left, right)
    sides = {
        "left": ([left.paths[i] for i in i_left], (left.camera.width, left.camera.height), rectified.left_maps),
        "right": ([right.paths[i] for i in i_right], (right.camera.width, right.camera.height), rectified.right_maps),
    }

    def read(side: Side, i: int) -> Image:
        paths, size, maps = sides[side]
        return remapped(read_grey(paths[i], size), maps)

    times_ns = left.times_ns[i_left]
    truth, about = _truth(mav0, left.body_from_camera @ rectified.left_from_rectified, times_ns)
    notes = left.notes + right.notes + unmatched_note(len(left.paths), len(right.paths), len(i_left))
    imu = euroc_imu(mav0, rectified.left_from_rectified.inverse(), left.body_from_camera.inverse())
    found = _found(mav0, ("cam0", "cam1"), about)
    return Recording(
        name, rectified.camera, rectified.baseline_m, times_ns, read, truth, notes, found=found, sensors=imu
    )


def _found(mav0: Path, cameras: tuple[str, ...], truth: tuple[Found, ...]) -> tuple[Found, ...]:
    """Returns the other files in the folder, except those of the IMU."""
    found = [Found("lens", str(mav0 / name / "sensor.yaml")) for name in cameras]
    found += [*(Found("times", str(mav0 / name / "data.csv")) for name in cameras), *truth]
    known = {*(Path(each.where).parent.name for each in found), EUROC_IMU}
    others = [mav0 / name for name in names(mav0) if name not in known and not name.startswith(".")]
    why = "is not used: cameras, the IMU and one track of the body are read"
    return (*found, *(Found("other", str(path), False, why) for path in others if is_folder(path) and names(path)))


def _rectification(mav0: Path, left: _Sensor, right: _Sensor) -> Rectification:
    left_from_right = left.body_from_camera.inverse() @ right.body_from_camera
    file = mav0 / "cam1" / "sensor.yaml"
    if fault := pair_fault(left_from_right):
        raise InputError(f"{file}: T_BS does not put cam1 to the right of cam0 ({fault}): correct it")
    try:
        rectification = Rectification.of(left.camera, right.camera, left_from_right.inverse())
    except ValueError as error:
        raise InputError(f"{file}: cam1 and cam0 are no pair ({error}): give a pair of equal cameras") from None
    if rectification.baseline_m <= 0:
        raise InputError(f"{file}: T_BS does not put cam1 to the right of cam0: correct it")
    return rectification


def _sensor(folder: Path) -> _Sensor:
    placed = read_euroc_sensor(folder / "sensor.yaml")
    camera = placed.camera
    times_ns, names = _image_list(folder / "data.csv")
    there, notes = those_there(folder / "data.csv", [folder / "data" / name for name in names])
    paths = [folder / "data" / names[i] for i in there]
    require_size(paths[0], (camera.width, camera.height))
    return _Sensor(camera, placed.pose, times_ns[there], paths, placed.notes + notes)


def _image_list(path: Path) -> tuple[NDArray[np.int64], list[str]]:
    """Returns times (N,) [ns] and file names of a data.csv."""
    times_ns, names = [], []
    for line, text in enumerate(read_text(path).splitlines(), 1):
        stamp, comma, name = (word.strip() for word in text.partition(","))
        if not text.strip() or stamp.startswith("#"):
            continue
        time_ns = nanoseconds(stamp)
        if not comma or not name or time_ns is None:
            raise InputError(f"{path} line {line} is not 'time in nanoseconds,file name': correct that line")
        if times_ns and time_ns <= times_ns[-1]:
            raise InputError(f"{path} line {line}: time {stamp} is not after the one before: put the lines in order")
        times_ns.append(time_ns)
        names.append(name)
    if not names:
        raise InputError(f"{path} lists no image: restore the file")
    return np.array(times_ns, np.int64), names


def _truth(
    mav0: Path, body_from_left: Pose, times_ns: NDArray[np.int64]
) -> tuple[Trajectory | None, tuple[Found, ...]]:
    """Returns world_from_left at the images' times, from the body's poses, and a note if it has none there."""
    path = next((mav0 / name / "data.csv" for name in TRUTHS if exists(mav0 / name / "data.csv")), None)
    if path is None:
        return None, ()
    truth = truth_at(read_euroc(path, "body"), times_ns)
    if truth is None:
        return None, (Found("truth", str(path), False, "has no pose at the times of the images: no ground truth."),)
    return truth.moved(right=body_from_left, frame="left"), (Found("truth", str(path)),)
