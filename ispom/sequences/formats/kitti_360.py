"""KITTI-360: `data_2d_raw/2013_05_28_drive_NNNN_sync` with `image_00/data_rect` and `image_01/data_rect`.

The images are rectified; their camera is P_rect of `calibration/perspective.txt`, their times are `timestamps.txt`
(a line for each number of an image), and the ground truth is `data_poses/DRIVE/cam0_to_world.txt`: the number of an
image and world_from_left (4, 4). Written from public documentation: the page "documentation" of the data set, and
kitti360Scripts.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ispom.errors import InputError
from ispom.io.camera import usable
from ispom.io.files import exists
from ispom.io.kitti import read_calibration, read_timestamps
from ispom.io.poses.recognised import read_trajectory
from ispom.sequences.formats.folder import holds_images, named_images
from ispom.sequences.guess import size_of_photo
from ispom.sequences.images import read_image
from ispom.sequences.recording import Recording, Side
from ispom.sequences.stereo_stream import level_pair
from ispom.sequences.stream import Stream
from ispom.types import Camera, Image, Trajectory

SIDES: dict[Side, str] = {"left": "00", "right": "01"}
IMAGES, CALIBRATION, POSES = "data_rect", "calibration/perspective.txt", "cam0_to_world.txt"


def looks_like_kitti_360(folder: Path) -> bool:
    """Checks whether a folder has the rectified left images."""
    return holds_images(_images(folder, "left"))


def open_kitti_360(folder: Path) -> Recording:
    """Returns the recording of a drive. Raises InputError that names the missing or invalid file."""
    real = folder.resolve()
    root = real.parent.parent
    sides: list[Side] = [side for side in SIDES if holds_images(_images(folder, side))]
    path = root / CALIBRATION
    if not exists(path):
        raise InputError(f"{path} is missing: put the folder calibration of the data set beside data_2d_raw")
    names = tuple(f"P_rect_{SIDES[side]}" for side in sides)
    projections = read_calibration(path, names)
    p = projections[names[0]]
    fx, fy, cx, cy = p[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
    first = _images(folder, "left") / named_images(_images(folder, "left")).names[0]
    camera = usable(Camera(*size_of_photo(first), fx, fy, cx, cy), f"{path}: {names[0]}")
    baseline_m = None
    if "right" in sides:
        q = projections.get(names[1])
        if q is None or abs(q[:, :3] - p[:, :3]).max() > 1e-6 * fx or p[0, 3] <= q[0, 3]:
            raise InputError(f"{path}: P_rect_01 is not P_rect_00 moved to the right: give the data set's own file")
        baseline_m = float((p[0, 3] - q[0, 3]) / fx)
    streams: dict[Side, Stream] = {side: _stream(folder, side, camera) for side in sides}
    times_ns, read, notes = level_pair(folder, streams)
    poses = next((place for place in (root / "data_poses" / real.name / POSES, real / POSES) if exists(place)), None)
    truth = None if poses is None else _truth(poses, read_timestamps(_stamps(folder, "left")))
    if truth is not None:
        truth = truth.select(np.isin(truth.times_ns, times_ns))
    return Recording(f"KITTI-360 {real.name}", camera, baseline_m, times_ns, read, truth, notes)


def _images(folder: Path, side: Side) -> Path:
    return folder / f"image_{SIDES[side]}" / IMAGES


def _stamps(folder: Path, side: Side) -> Path:
    path = folder / f"image_{SIDES[side]}" / "timestamps.txt"
    if not exists(path):
        raise InputError(f"{path} is missing: put the time stamps of the perspective images there")
    return path


def _stream(folder: Path, side: Side, camera: Camera) -> Stream:
    inside = _images(folder, side)
    images, path = named_images(inside), _stamps(folder, side)
    stamps_ns = read_timestamps(path)
    if images.numbers is None or int(images.numbers[-1]) >= len(stamps_ns):
        raise InputError(f"{path} has {len(stamps_ns)} times, not one for each of {inside}: give the whole file")
    paths, size = [inside / name for name in images.names], (camera.width, camera.height)

    def read(i: int) -> Image:
        return read_image(paths[i], size)

    return Stream(stamps_ns[images.numbers], read)


def _truth(path: Path, stamps_ns: np.ndarray) -> Trajectory:
    file = read_trajectory(path, stamps_ns)
    if not (file.numbered and file.timed):
        raise InputError(f"{path} has no numbers of images before its poses: give the data set's own file")
    return file.trajectory
