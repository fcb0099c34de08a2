"""The recordings that UZH's course "Vision Algorithms for Mobile Robotics" has besides KITTI 05: Parking and Malaga.

Parking, a synthetic drive of one camera: `images/img_00000.png`, `K.txt` (a camera matrix) and `poses.txt`
(world_from_camera, as in KITTI). It has no times: 30 images per second are assumed.

Malaga, extract 07 and others of the Malaga Stereo and Laser Urban Data Set (Blanco et al., IJRR 33(2), 2014):
`NAME_rectified_800x600_Images/img_CAMERA1_TIME_left.jpg` and `..._right.jpg`, with the cameras in
`camera_params_rectified_a=0_800x600.txt` beside that folder. Without that file the left images are read alone, with the
published values of extract 07. The GPS track is not read as truth: it is less exact than what is to be measured.
"""

from __future__ import annotations

import configparser
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError, counted
from ispom.geometry import Pose
from ispom.io.camera import intrinsics_of, usable
from ispom.io.files import exists, is_folder, names
from ispom.io.kitti import read_poses
from ispom.io.rows import numbers, read_text
from ispom.io.values import number
from ispom.sequences.formats.folder import holds_images, named_images
from ispom.sequences.guess import size_of_photo
from ispom.sequences.images import read_image, require_size
from ispom.sequences.recording import Recording
from ispom.sequences.sidecars import used
from ispom.sequences.stereo_stream import stereo_stream
from ispom.sequences.stream import NOMINAL_HZ, Stream, size_of
from ispom.types import Camera, Found, Rig, Trajectory

MATRIX, POSES, IMAGES = "K.txt", "poses.txt", "images"

# Parking.


def looks_like_parking(folder: Path) -> bool:
    """Returns whether there is a camera matrix next to a folder of images."""
    return exists(folder / MATRIX) and holds_images(folder / IMAGES)


def open_parking(folder: Path) -> Recording:
    """Returns the recording. Raises InputError that names the missing or invalid file."""
    images = named_images(folder / IMAGES)
    paths = [folder / IMAGES / name for name in images.names]
    index = np.arange(len(paths)) if images.numbers is None else images.numbers
    times_ns = np.rint((index - index[0]) * (1e9 / NOMINAL_HZ)).astype(np.int64)
    camera, notes = _camera_of(folder / MATRIX, size_of_photo(paths[0]))
    notes += (f"{folder / IMAGES} has no times: {NOMINAL_HZ:g} images per second assumed",)
    size = size_of(camera)
    name = f"VAMR {folder.resolve().name}"
    truth = _poses(folder / POSES, index, times_ns) if exists(folder / POSES) else None
    notes = images.notes + notes
    found = used(("lens", folder / MATRIX), ("truth", folder / POSES if truth is not None else None))
    return Recording(name, camera, None, times_ns, lambda _, i: read_image(paths[i], size), truth, notes, found=found)


def _camera_of(path: Path, size: tuple[int, int]) -> tuple[Camera, tuple[str, ...]]:
    """Reads a camera matrix, whose numbers may have commas between them."""
    rows = [(n, text.replace(",", " ").split()) for n, text in enumerate(read_text(path).splitlines(), 1)]
    rows = [(n, words) for n, words in rows if words]
    if [len(words) for _, words in rows] != [3, 3, 3]:
        raise InputError(f"{path} is no camera matrix of three rows of three numbers: restore the file")
    matrix = np.stack([numbers(path, n, words) for n, words in rows])
    (fx, fy, cx, cy), notes = intrinsics_of(path, "the camera matrix", matrix)
    return usable(Camera(*size, fx, fy, cx, cy), str(path)), notes


def _poses(path: Path, index: NDArray[np.int64], times_ns: NDArray[np.int64]) -> Trajectory:
    """Returns world_from_camera: a row for each number of an image."""
    poses = read_poses(path)
    if len(poses) <= index[-1]:
        raise InputError(f"{path} has {len(poses)} poses, but the last image is number {index[-1]}: restore the file")
    return Trajectory.of([(int(t), poses[i]) for t, i in zip(times_ns, index, strict=True)], "left")


# Malaga.

RECTIFIED = re.compile(r".*_rectified_([0-9]{2,5}x[0-9]{2,5})_Images")
IMAGE = re.compile(r"img_CAMERA[0-9]_([0-9]{1,10})\.([0-9]{1,9})_(left|right)\.(jpg|jpeg|png)", re.IGNORECASE)
SIZE = "800x600"
"""Size of the images that the course uses; their folder has priority over others."""
PUBLISHED = Camera(800, 600, 621.18428, 621.18428, 404.0076, 309.05989)
"""The left rectified camera of extract 07, from the course's exercise."""


def looks_like_malaga(folder: Path) -> bool:
    """Returns whether there are rectified images of the data set in it, or in a folder with their name."""
    return is_folder(folder) and (bool(_folders(folder)) or any(IMAGE.fullmatch(name) for name in names(folder)))


def open_malaga(folder: Path) -> Recording:
    """Returns the recording. Raises InputError that names the missing or invalid file."""
    inner = _folders(folder)
    images = folder / inner[0] if inner else folder
    above = folder if inner else folder.resolve().parent
    left, right = ({t: images / name for t, name in sorted(_images(images, side))} for side in ("left", "right"))
    if not left:
        raise InputError(f"{images} holds no image img_CAMERA1_TIME_left.jpg: restore the images")
    name, first = f"Malaga {above.resolve().name}", next(iter(left.values()))
    rig, notes = _rig(above, images, size_of_photo(first))
    require_size(first, size_of(rig.camera("left")))
    why = "is not used: of Malaga the cameras are read"
    others = [name for name in names(above) if "_all-sensors_" in name]
    found = tuple(Found("other", str(above / name), False, why) for name in others)
    streams = [_stream(paths, size_of(rig.camera("left"))) for paths in (left, right)]
    if not right or not rig.has_stereo:
        times_ns, read = streams[0].times_ns, streams[0].read
        return Recording(name, rig.camera("left"), None, times_ns, lambda _, i: read(i), None, notes, found=found)
    stereo = stereo_stream(images, rig, *streams)
    camera, baseline_m = stereo.rig.camera("left"), stereo.rig.baseline_m
    notes += stereo.notes
    return Recording(name, camera, baseline_m, stereo.times_ns, stereo.read, None, notes, found=found)


def _folders(folder: Path) -> list[str]:
    """Returns the folders of rectified images, those of the course's size first."""
    found = [name for name in names(folder) if RECTIFIED.fullmatch(name) and is_folder(folder / name)]
    return sorted(found, key=lambda name: (SIZE not in name, name))


def _images(folder: Path, side: str) -> list[tuple[int, str]]:
    """Returns times [ns] and names; the digits after the point are those of a decimal fraction."""
    matches = [match for name in names(folder) if (match := IMAGE.fullmatch(name)) is not None]
    return [(int(m[1]) * 10**9 + int(m[2].ljust(9, "0")), m[0]) for m in matches if m[3].lower() == side]


def _stream(paths: dict[int, Path], size: tuple[int, int]) -> Stream:
    ordered = list(paths.values())
    return Stream(np.array(list(paths), np.int64), lambda i: read_image(ordered[i], size))


def _rig(above: Path, images: Path, size: tuple[int, int]) -> tuple[Rig, tuple[str, ...]]:
    """Returns the pair, rectified up to its principal points; or the left camera, and a note that its values are those
    that are published."""
    path = above / f"camera_params_rectified_a=0_{size[0]}x{size[1]}.txt"
    if not exists(path):
        if size != size_of(PUBLISHED):
            raise InputError(f"{path} is missing: restore it, or give the images of 800 x 600")
        used = f"the published focal length of {PUBLISHED.fx:g} px is used, and the left images alone"
        return Rig.of(left=PUBLISHED), (f"{path} is missing: {used}",)
    content = configparser.ConfigParser(inline_comment_prefixes=("//", ";"), comment_prefixes=("//", "#", ";"))
    try:
        content.read_string(read_text(path))
    except configparser.Error:
        raise InputError(f"{path} has no sections with NAME=VALUE as the data set has them: restore the file") from None
    left, right = (_rectified_camera(path, content, f"CAMERA_{side}", size) for side in ("LEFT", "RIGHT"))
    baseline_m = _values(path, content, "CAMERA_LEFT2RIGHT_POSE", "pose_quaternion", 7)[0]
    if baseline_m <= 0:
        raise InputError(f"{path}: pose_quaternion does not put the right camera to the right: restore the file")
    poses = {"rig_from_left": Pose(), "rig_from_right": Pose(translation=np.array([baseline_m, 0.0, 0.0]))}
    return Rig.of(left=left, right=right, **poses), ()


def _rectified_camera(path: Path, content: configparser.ConfigParser, section: str, size: tuple[int, int]) -> Camera:
    fx, fy, cx, cy = (_values(path, content, section, key, 1)[0] for key in ("fx", "fy", "cx", "cy"))
    return usable(Camera(*size, fx, fy, cx, cy), f"{path}: {section}")


def _values(path: Path, content: configparser.ConfigParser, section: str, key: str, count: int) -> list[float]:
    words = content.get(section, key, fallback="").strip().strip("[]").replace(",", " ").split()
    if len(words) != count:
        wanted = counted(count, "number")
        raise InputError(f"{path}: {section} has no {key} of {wanted}: restore the file")
    return [number(f"{path}: {section} {key}", word) for word in words]
