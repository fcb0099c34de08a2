"""KITTI odometry drives: `sequences/NN` with image_0, image_1, calib.txt and times.txt; `poses/NN.txt` beside it.

The right camera (image_1) and the poses may be missing.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.io.camera import usable
from ispom.io.files import exists, is_folder, names
from ispom.io.kitti import read_calibration, read_poses, read_times
from ispom.sequences.images import read_grey
from ispom.sequences.recording import Recording, Side
from ispom.types import Camera, Image, Trajectory


def looks_like_kitti(folder: Path) -> bool:
    """Whether anything that only a KITTI odometry drive has is there."""
    return any(exists(folder / name) for name in ("image_0", "image_1", "calib.txt"))


def open_kitti(folder: Path) -> Recording:
    """The recording of a folder `sequences/NN`; InputError names the file that is missing or wrong."""
    count = _count(folder / "image_0")
    camera, baseline_m = _cameras(folder)
    if baseline_m is not None and (right := _count(folder / "image_1")) != count:
        raise InputError(
            f"{folder / 'image_1'} holds {right} images, image_0 {count}: restore the missing ones, or move image_1 "
            "away to run the left camera alone"
        )
    times_ns = read_times(folder / "times.txt")
    if len(times_ns) < count:
        raise InputError(f"{folder / 'times.txt'} has {len(times_ns)} times for {count} images: give the complete file")
    size, sides = (camera.width, camera.height), {"left": "image_0", "right": "image_1"}

    def read(side: Side, i: int) -> Image:
        return read_grey(folder / sides[side] / f"{i:06d}.png", size)

    name = folder.resolve().name
    return Recording(f"KITTI {name}", camera, baseline_m, times_ns[:count], read, _truth(folder, times_ns[:count]))


def _count(images: Path) -> int:
    """How many images there are, numbered from 0 without a gap."""
    if not is_folder(images):
        raise InputError(f"{images} is missing: give a drive with its images")
    found = [name for name in names(images) if name.endswith(".png") and not name.startswith(".")]
    if not found:
        raise InputError(f"{images} holds no .png image: give a drive with its images")
    gap = next((i for i, name in enumerate(found) if name != f"{i:06d}.png"), None)
    if gap is not None:
        raise InputError(f"{images / f'{gap:06d}.png'} is missing: images are numbered from 0 without a gap")
    return len(found)


def _cameras(folder: Path) -> tuple[Camera, float | None]:
    """The camera of both sides, and the baseline [m] if there is a right one."""
    projections = read_calibration(folder / "calib.txt")
    height, width = read_grey(folder / "image_0" / "000000.png").shape
    left = projections["P0"]
    fx, fy, cx, cy = left[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
    camera = usable(Camera(width, height, fx, fy, cx, cy), f"{folder / 'calib.txt'}: P0")
    if not is_folder(folder / "image_1"):
        return camera, None
    if "P1" not in projections:
        raise InputError(
            f"{folder / 'calib.txt'} has no line 'P1: ...' for image_1: give the calibration of this drive"
        )
    right = projections["P1"]
    baseline_m = float((left[0, 3] - right[0, 3]) / right[0, 0])
    if baseline_m <= 0 or abs(right[:, :3] - left[:, :3]).max() > 1e-6 * left[0, 0]:
        raise InputError(f"{folder / 'calib.txt'}: P1 is not P0 moved to the right: give the calibration of this drive")
    return camera, baseline_m


def _truth(folder: Path, times_ns: NDArray[np.int64]) -> Trajectory | None:
    """world_from_left of `poses/NN.txt` beside `sequences`, None where there is none."""
    folder = folder.resolve()
    path = folder.parent.parent / "poses" / f"{folder.name}.txt"
    if not exists(path):
        return None
    poses = read_poses(path)
    if len(poses) < len(times_ns):
        raise InputError(
            f"{path} has {len(poses)} poses for {len(times_ns)} images: give the complete file, or move it away to run "
            "without truth"
        )
    return Trajectory.of(list(zip(times_ns.tolist(), poses, strict=False)), "left")
