"""TartanAir (both versions): `image_left`, `image_right` and `pose_left.txt`, or `image_lcam_front` and so on.

The pair is rectified; its camera is that which the data set publishes (fx = fy = 320, baseline 0.25 m), and there are
no times. Poses are `x y z qx qy qz qw` of the left camera with x ahead, y to the right and z down, turned here
to x to the right, y down and z ahead. Source: TartanAir tools, README and `evaluation/transformation.py`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ispom.errors import InputError
from ispom.io.files import exists, names
from ispom.io.rows import numbers, read_rows
from ispom.sequences.formats.folder import folder_stream, holds_images, named_images
from ispom.sequences.guess import size_of_photo
from ispom.sequences.recording import Recording, Side
from ispom.sequences.sidecars import used
from ispom.sequences.stream import Clock
from ispom.types import Camera, Found, Image, Trajectory

VERSIONS = (
    ("image_left", "image_right", "pose_left.txt", Camera(640, 480, 320.0, 320.0, 320.0, 240.0)),
    ("image_lcam_front", "image_rcam_front", "pose_lcam_front.txt", Camera(640, 640, 320.0, 320.0, 320.0, 320.0)),
)
"""Folders, the file of poses, and the published camera."""
BASELINE_M = 0.25
"""Baseline that the data set's page publishes."""
BODY_FROM_CAMERA = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
MAX_LENGTH_ERROR = 0.01
"""Largest deviation of a quaternion's length from 1."""


def looks_like_tartanair(folder: Path) -> bool:
    """Checks whether a folder has the left images and their poses."""
    return any(exists(folder / poses) and holds_images(folder / left) for left, _, poses, _ in VERSIONS)


def open_tartanair(folder: Path) -> Recording:
    """Returns the recording of a trajectory such as P001. Raises InputError that names the missing or invalid file."""
    left, right, poses, camera = next(each for each in VERSIONS if exists(folder / each[2]))
    sides: dict[Side, str] = {"left": left, "right": right}
    sides = {side: name for side, name in sides.items() if holds_images(folder / name)}
    named = {side: named_images(folder / name) for side, name in sides.items()}
    first = folder / left / named["left"].names[0]
    if (size := size_of_photo(first)) != (camera.width, camera.height):
        raise InputError(
            f"{first} is {size[0]} x {size[1]}, and the camera of TartanAir is published for {camera.width} x "
            f"{camera.height}: restore the images, or write a camera.yaml and give {folder / left}"
        )
    if len({len(each.names) for each in named.values()}) > 1:
        raise InputError(f"{folder} has another number of left than of right images: restore the missing ones")
    streams = {side: folder_stream(folder / sides[side], size, Clock(), named[side]) for side in sides}
    times_ns = streams["left"].times_ns

    def read(side: Side, i: int) -> Image:
        return streams[side].read(i)

    rows = read_rows(folder / poses, 7)
    if len(rows) != len(times_ns):
        raise InputError(f"{folder / poses} has {len(rows)} poses for {len(times_ns)} images: give the complete file")
    values = np.array([numbers(folder / poses, line, words) for line, words in rows])
    lengths = np.linalg.norm(values[:, 3:], axis=1)
    if len(wrong := np.flatnonzero(abs(lengths - 1) > MAX_LENGTH_ERROR)):
        raise InputError(f"{folder / poses} line {rows[wrong[0]][0]}: its quaternion is not of length 1: correct it")
    rotations = Rotation.from_quat(values[:, 3:]).as_matrix() @ BODY_FROM_CAMERA
    truth = Trajectory(times_ns, rotations, values[:, :3], "left")
    baseline_m = BASELINE_M if "right" in sides else None
    name, notes = f"TartanAir {folder.resolve().name}", streams["left"].notes
    found = (*used(("truth", folder / poses)), *_not_used(folder))
    return Recording(name, camera, baseline_m, times_ns, read, truth, notes, found=found)


def _not_used(folder: Path) -> tuple[Found, ...]:
    """Returns depth, optical flow and IMU of the simulation, which are not used."""
    why = "is not used: of TartanAir the images and the poses are read"
    others = [name for name in names(folder) if name.startswith(("depth", "flow", "seg", "imu", "lidar"))]
    return tuple(Found("imu" if name.startswith("imu") else "other", str(folder / name), False, why) for name in others)
