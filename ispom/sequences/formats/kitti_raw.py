"""KITTI raw drives: `DAY_drive_NNNN_sync` (rectified) or `_extract` (rectified here), calibrated by their day's folder.

The grey cameras (image_00, image_01) are read, or else the colour ones (image_02, image_03); the right one may be
missing. The ground truth is the GPS/IMU track (oxts), if that and its calibration exist.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.io.camera import usable
from ispom.io.files import exists, is_folder, names
from ispom.io.kitti import image_size, raw_camera, read_calibrations, read_oxts, read_rigid, read_timestamps
from ispom.sequences.images import read_image
from ispom.sequences.matching import truth_at, unmatched_note
from ispom.sequences.recording import Recording, Side
from ispom.sequences.rectification import Maps, remapped, undistortion
from ispom.sequences.sensors_beside import oxts_sensors
from ispom.types import Camera, Found, Image, Trajectory

_PAIRS = (("00", "01"), ("02", "03"))
_CALIBRATION = "calib_cam_to_cam.txt"
_IMU, _VELO = "calib_imu_to_velo.txt", "calib_velo_to_cam.txt"
_TRUTH_GAP_NS = 250_000_000
"""Largest gap between samples over which the truth is interpolated: they are 100 ms apart, and single ones are
missing."""


def looks_like_kitti_raw(folder: Path) -> bool:
    """Checks whether it is a drive with a left camera, grey or in colour."""
    return any(is_folder(folder / f"image_{left}" / "data") for left, _ in _PAIRS)


def open_kitti_raw(folder: Path) -> Recording:
    """Returns the recording of a drive. Raises InputError that names the missing or invalid file."""
    left, right = next(pair for pair in _PAIRS if is_folder(folder / f"image_{pair[0]}" / "data"))
    cameras = (left, right) if is_folder(folder / f"image_{right}" / "data") else (left,)
    path = _calibration_path(folder, _CALIBRATION)
    if path is None:
        missing = folder.resolve().parent / _CALIBRATION
        raise InputError(f"{missing} is missing: put the calibration of the drive's day there")
    calibrations = read_calibrations(path, cameras)
    images = [_images(folder, camera) for camera in cameras]
    frames, notes = _frames(folder, images)
    stamps = folder / f"image_{left}" / "timestamps.txt"
    times_ns = read_timestamps(stamps)
    if frames[-1] >= len(times_ns):
        raise InputError(f"{stamps} has {len(times_ns)} times, none for image {frames[-1]:010d}: give the whole file")
    camera, baseline_m = _rectified(path, calibrations)
    first = images[0][frames[0]]
    size = read_image(first).shape[1::-1]
    if size not in (sizes := [image_size(calibrations[0][name]) for name in ("S_rect", "S")]):
        raise InputError(f"{first} is {size[0]} x {size[1]}, which is not in {path}: give the calibration of its day")
    raw = size != sizes[0]
    sides = {
        side: ([paths[i] for i in frames], image_size(found["S" if raw else "S_rect"]), _maps(found) if raw else None)
        for side, paths, found in zip(("left", "right"), images, calibrations, strict=False)
    }

    def read(side: Side, i: int) -> Image:
        paths, size, maps = sides[side]
        image = read_image(paths[i], size)
        return image if maps is None else remapped(image, maps)

    name = f"KITTI raw {folder.resolve().name}"
    oxts = folder / "oxts"
    left_from_body, why = _left_from_body(folder, left, calibrations[0], path)
    truth, about = _truth(oxts, left_from_body, why, times_ns[frames])
    found = [Found("lens", str(path)), Found("times", str(stamps))]
    sensors = ()
    if is_folder(oxts / "data"):
        sensors = oxts_sensors(oxts, left_from_body, f"is not used, as its pose on the rig is not known ({why})")
        found.append(Found("truth", str(oxts), truth is not None, "" if truth is not None else "is no ground truth"))
    if is_folder(folder / "velodyne_points"):
        found.append(Found("laser", str(folder / "velodyne_points"), False, "is not used: scans of KITTI are not read"))
    return Recording(
        name, camera, baseline_m, times_ns[frames], read, truth, (*notes, about), found=tuple(found), sensors=sensors
    )


def _calibration_path(folder: Path, name: str) -> Path | None:
    places = (folder / name, folder.resolve().parent / name)
    return next((place for place in places if exists(place)), None)


def _left_from_body(folder: Path, left: str, calibration: dict[str, Array], path: Path) -> tuple[Pose | None, str]:
    """Returns the pose of the GPS/IMU unit in the rectified left camera, or None and why it is not known."""
    imu, velo = _calibration_path(folder, _IMU), _calibration_path(folder, _VELO)
    if imu is None or velo is None:
        return None, f"{folder.resolve().parent / (_IMU if imu is None else _VELO)} is missing"
    first = calibration if left == _PAIRS[0][0] else read_calibrations(path, (_PAIRS[0][0],))[0]
    turned = Pose(Rotation.from_matrix(first["R_rect"]).as_matrix())
    projection = calibration["P_rect"]
    left_from_rectified = Pose(translation=np.linalg.solve(projection[:, :3], projection[:, 3]))
    return left_from_rectified @ turned @ read_rigid(velo) @ read_rigid(imu), ""


def _truth(
    oxts: Path, left_from_body: Pose | None, why: str, times_ns: NDArray[np.int64]
) -> tuple[Trajectory | None, str]:
    """Returns world_from_left at the images' times, and a note about it."""
    if not is_folder(oxts / "data"):
        return None, "The drive has no GPS/IMU track (oxts): no ground truth."
    if left_from_body is None:
        return None, f"{why}, without which the GPS/IMU track (oxts) cannot be used: no ground truth."
    truth = truth_at(read_oxts(oxts), times_ns, _TRUTH_GAP_NS)
    note = "The ground truth is the GPS/IMU track: smooth, but off by decimetres, and more where GPS is poor. A method "
    note += "that uses its GNSS or IMU is compared with its own input, so that its error is not meaningful."
    if truth is None:
        return None, "The GPS/IMU track (oxts) is of other times than the images: no ground truth."
    return truth.moved(right=left_from_body.inverse(), frame="left"), note


def _images(folder: Path, camera: str) -> dict[int, Path]:
    """Returns the image files by their number."""
    data = folder / f"image_{camera}" / "data"
    paths = [data / name for name in names(data)]
    return {int(p.stem): p for p in paths if p.stem.isascii() and p.stem.isdigit() and len(p.stem) <= 10}


def _frames(folder: Path, images: list[dict[int, Path]]) -> tuple[list[int], tuple[str, ...]]:
    """Returns the numbers of the images that every camera has, and notes about the others."""
    common = sorted(set.intersection(*(set(found) for found in images)))
    if not common:
        raise InputError(f"{folder} holds no image that every camera has: restore the images")
    return common, unmatched_note(len(images[0]), len(images[1]), len(common)) if len(images) == 2 else ()


def _rectified(path: Path, calibrations: list[dict[str, Array]]) -> tuple[Camera, float | None]:
    """Returns the rectified camera of both sides, and the baseline [m] where there are two."""
    left = calibrations[0]["P_rect"]
    fx, fy, cx, cy = left[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
    camera = usable(Camera(*image_size(calibrations[0]["S_rect"]), fx, fy, cx, cy), f"{path}: P_rect")
    if len(calibrations) == 1:
        return camera, None
    right = calibrations[1]["P_rect"]
    baseline_m = float((left[0, 3] - right[0, 3]) / right[0, 0])
    same = image_size(calibrations[1]["S_rect"]) == image_size(calibrations[0]["S_rect"])
    if not same or baseline_m <= 0 or np.abs(right[:, :3] - left[:, :3]).max() > 1e-6 * fx:
        raise InputError(f"{path}: the right camera is not the left one moved to the right: give the day's calibration")
    return camera, baseline_m


def _maps(calibration: dict[str, Array]) -> Maps:
    size = image_size(calibration["S_rect"])
    return undistortion(raw_camera(calibration), calibration["R_rect"], calibration["P_rect"], size)
