"""KITTI raw drives: `DAY_drive_NNNN_sync` (rectified) or `_extract` (rectified here), calibrated by their day's folder.

The grey cameras (image_00, image_01) are read, or else the colour ones (image_02, image_03); the right one may be
missing. The GPS/IMU track (oxts) is not read: there is no truth.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.kitti_raw import image_size, raw_camera, read_calibrations, read_timestamps
from ispom.sequences.images import read_image
from ispom.sequences.matching import unmatched_note
from ispom.sequences.recording import Recording, Side
from ispom.sequences.rectification import Maps, remapped, undistortion
from ispom.types import Camera, Image

_PAIRS = (("00", "01"), ("02", "03"))
_CALIBRATION = "calib_cam_to_cam.txt"
_NOTE = "The GPS/IMU track of a KITTI raw drive is not read: no truth."


def looks_like_kitti_raw(folder: Path) -> bool:
    """Whether it is a drive with a left camera, grey or in colour."""
    return any((folder / f"image_{left}" / "data").is_dir() for left, _ in _PAIRS)


def open_kitti_raw(folder: Path) -> Recording:
    """The recording of a drive; InputError names the file that is missing or wrong."""
    left, right = next(pair for pair in _PAIRS if (folder / f"image_{pair[0]}" / "data").is_dir())
    cameras = (left, right) if (folder / f"image_{right}" / "data").is_dir() else (left,)
    path = _calibration_path(folder)
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
    return Recording(name, camera, baseline_m, times_ns[frames], read, notes=(*notes, _NOTE))


def _calibration_path(folder: Path) -> Path:
    places = (folder / _CALIBRATION, folder.resolve().parent / _CALIBRATION)
    for place in places:
        if place.exists():
            return place
    raise InputError(f"{places[1]} is missing: put the calibration of the drive's day there")


def _images(folder: Path, camera: str) -> dict[int, Path]:
    """The image files by their number."""
    data = folder / f"image_{camera}" / "data"
    return {int(p.stem): p for p in data.iterdir() if p.stem.isascii() and p.stem.isdigit() and len(p.stem) <= 10}


def _frames(folder: Path, images: list[dict[int, Path]]) -> tuple[list[int], tuple[str, ...]]:
    """The numbers of the images that every camera has, and what to tell about the others."""
    common = sorted(set.intersection(*(set(found) for found in images)))
    if not common:
        raise InputError(f"{folder} holds no image that every camera has: restore the images")
    return common, unmatched_note(len(images[0]), len(images[1]), len(common)) if len(images) == 2 else ()


def _rectified(path: Path, calibrations: list[dict[str, Array]]) -> tuple[Camera, float | None]:
    """The rectified camera of both sides, and the baseline [m] where there are two."""
    left = calibrations[0]["P_rect"]
    fx, fy, cx, cy = left[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
    camera = Camera(*image_size(calibrations[0]["S_rect"]), fx, fy, cx, cy)
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
