"""KITTI odometry drives: `sequences/NN` with image_0, image_1, calib.txt and times.txt; `poses/NN.txt` next to it.

Without image_0, the colour cameras (image_2, image_3) are read. The right camera and the poses may be missing, and the
images may be copies in another format.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.io.camera import usable
from ispom.io.files import exists, is_folder, names
from ispom.io.kitti import read_calibration, read_poses, read_times
from ispom.sequences.images import IMAGE_SUFFIXES, read_grey, read_image
from ispom.sequences.recording import Recording, Side
from ispom.sequences.sensors_beside import sensors_beside
from ispom.sequences.sidecars import used
from ispom.types import Camera, Image, Trajectory

PAIRS = (("image_0", "image_1"), ("image_2", "image_3"))


def looks_like_kitti(folder: Path) -> bool:
    """Checks whether a folder has files that only a KITTI odometry drive has."""
    return any(exists(folder / name) for name in (*PAIRS[0], "calib.txt"))


def open_kitti(folder: Path) -> Recording:
    """Returns the recording of a folder `sequences/NN`. Raises InputError that names the missing or invalid file."""
    left, right = next((pair for pair in PAIRS if is_folder(folder / pair[0])), PAIRS[0])
    paths = {"left": _images(folder / left)}
    count = len(paths["left"])
    read_pixels = read_grey if left == PAIRS[0][0] else read_image
    height, width = read_pixels(paths["left"][0]).shape[:2]
    camera, baseline_m, shift_m = _cameras(folder, left, right, (width, height))
    if baseline_m is not None:
        paths["right"] = _images(folder / right)
        if (others := len(paths["right"])) != count:
            raise InputError(
                f"{folder / right} holds {others} images, {left} {count}: restore the missing ones, or move {right} "
                "away to run the left camera alone"
            )
    times_ns = read_times(folder / "times.txt")
    if len(times_ns) < count:
        raise InputError(f"{folder / 'times.txt'} has {len(times_ns)} times for {count} images: give the complete file")
    size = (camera.width, camera.height)

    def read(side: Side, i: int) -> Image:
        return read_pixels(paths[side][i], size)

    truth = _truth(folder, times_ns[:count])
    if truth is not None and left != PAIRS[0][0]:
        truth = truth.moved(right=Pose(translation=-shift_m))
    found = used(("lens", folder / "calib.txt"), ("times", folder / "times.txt"), ("truth", _truth_path(folder)))
    name, sensors = f"KITTI {folder.resolve().name}", sensors_beside((folder,))
    return Recording(name, camera, baseline_m, times_ns[:count], read, truth, found=found, sensors=sensors)


def _images(images: Path) -> list[Path]:
    """Returns the images, numbered from 0 without a gap; of several copies of one, a PNG file."""
    if not is_folder(images):
        raise InputError(f"{images} is missing: give a drive with its images (image_0, or image_2 in colour)")
    paths = [Path(name) for name in names(images) if not name.startswith(".")]
    paths = [name for name in paths if name.suffix.lower() in IMAGE_SUFFIXES]
    if not paths:
        raise InputError(f"{images} holds no image: give a drive with its images")
    by_number: dict[str, Path] = {}
    for name in sorted(paths, key=lambda name: (name.stem, name.suffix.lower() != ".png", name.suffix)):
        by_number.setdefault(name.stem, name)
    gap = next((i for i, stem in enumerate(by_number) if stem != f"{i:06d}"), None)
    if gap is not None:
        missing = images / f"{gap:06d}{paths[0].suffix}"
        raise InputError(f"{missing} is missing: images are numbered from 0 without a gap")
    return [images / name for name in by_number.values()]


def _cameras(folder: Path, left: str, right: str, size: tuple[int, int]) -> tuple[Camera, float | None, Array]:
    """Returns the camera of both sides, and the baseline [m] if there is a right one.

    Also the offset (3,) [m] from positions in the camera of the truth to those in the left one.
    """
    first, second = (name.replace("image_", "P") for name in (left, right))
    projections = read_calibration(folder / "calib.txt", (first, second))
    projection = projections[first]
    fx, fy, cx, cy = projection[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
    camera = usable(Camera(*size, fx, fy, cx, cy), f"{folder / 'calib.txt'}: {first}")
    shift_m = np.linalg.solve(projection[:, :3], projection[:, 3])
    if not is_folder(folder / right):
        return camera, None, shift_m
    if second not in projections:
        raise InputError(
            f"{folder / 'calib.txt'} has no line '{second}: ...' for {right}: give the calibration of this drive"
        )
    other = projections[second]
    baseline_m = float((projection[0, 3] - other[0, 3]) / other[0, 0])
    if baseline_m <= 0 or abs(other[:, :3] - projection[:, :3]).max() > 1e-6 * projection[0, 0]:
        raise InputError(
            f"{folder / 'calib.txt'}: {second} is not {first} moved to the right: give the calibration of this drive"
        )
    return camera, baseline_m, shift_m


def _truth_path(folder: Path) -> Path | None:
    folder = folder.resolve()
    places = [place / "poses" / f"{folder.name}.txt" for place in (folder.parent.parent, folder.parent)]
    return next((place for place in places if exists(place)), None)


def _truth(folder: Path, times_ns: NDArray[np.int64]) -> Trajectory | None:
    """Returns world_from_left of `poses/NN.txt` next to `sequences`, or next to NN as in UZH's course; None without."""
    path = _truth_path(folder)
    if path is None:
        return None
    poses = read_poses(path)
    if len(poses) < len(times_ns):
        raise InputError(
            f"{path} has {len(poses)} poses for {len(times_ns)} images: give the complete file, or move it away to run "
            "without truth"
        )
    return Trajectory.of(list(zip(times_ns.tolist(), poses, strict=False)), "left")
