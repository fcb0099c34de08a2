"""7-Scenes style: `frame-000000.color.png` and, with its pose, `frame-000000.pose.txt`, in one folder (seq-01).

`camera.yaml` is in the folder or next to it; without one, the intrinsics on the data set's page are used.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ispom.errors import InputError
from ispom.io.files import exists, is_folder, names
from ispom.io.rows import matrix
from ispom.sequences.formats.folder import CAMERA, read_settings
from ispom.sequences.images import IMAGE_SUFFIXES, read_image, require_size
from ispom.sequences.recording import Recording
from ispom.sequences.sidecars import used
from ispom.sequences.stream import Clock, size_of
from ispom.types import Camera, Trajectory

COLOUR, POSE = ".color", ".pose.txt"
PUBLISHED = Camera(640, 480, 585.0, 585.0, 320.0, 240.0)
"""The camera of all sequences of the data set (Shotton et al. 2013, "Scene coordinate regression forests")."""
_PUBLISHED_NOTE = f"No {CAMERA}: the data set's published intrinsics are used (focal length 585 px, centre 320, 240)."


def looks_like_seven_scenes(folder: Path) -> bool:
    """Checks whether a folder has images called frame-NUMBER.color.EXTENSION."""
    return is_folder(folder) and any(_number(name) is not None for name in names(folder))


def open_seven_scenes(folder: Path, calibration: Path | None = None) -> Recording:
    """Returns the recording of one such folder. Raises InputError that names the missing or invalid file."""
    images = {number: name for name in names(folder) if (number := _number(name)) is not None}
    places = (folder / CAMERA, folder.resolve().parent / CAMERA)
    path = calibration or next((place for place in places if exists(place)), None)
    camera, clock, notes = PUBLISHED, Clock(), (_PUBLISHED_NOTE,)
    if path is not None:
        camera, clock, notes = read_settings(path)
    numbers = sorted(images)
    times_ns, note = clock.times_ns(folder, numbers[-1] + 1)
    times_ns = times_ns[numbers]  # a number that is missing is a gap in time
    paths, size = [folder / images[n] for n in numbers], size_of(camera)
    require_size(paths[0], size)
    truth, without = _truth(paths, times_ns)
    if truth is not None and without:
        notes += (f"{without} of {len(paths)} images have no pose, or one that is not finite.",)
    name = f"7-Scenes {folder.resolve().parent.name} {folder.resolve().name}"
    notes += (note,) if note else ()
    found = used(("lens", path), ("times", clock.times), ("truth", folder if truth is not None else None))
    return Recording(name, camera, None, times_ns, lambda _, i: read_image(paths[i], size), truth, notes, found=found)


def _number(name: str) -> int | None:
    match = re.fullmatch(rf"frame-([0-9]{{1,7}}){re.escape(COLOUR)}(\.[A-Za-z]+)", name)
    return int(match[1]) if match and match[2].lower() in IMAGE_SUFFIXES else None


def _pose_path(image: Path) -> Path:
    return image.with_name(image.stem.removesuffix(COLOUR) + POSE)


def _truth(images: list[Path], times_ns: NDArray[np.int64]) -> tuple[Trajectory | None, int]:
    """Returns world_from_camera, and the number of images without a pose."""
    known, matrices, there = [], [], set(names(images[0].parent))
    for i, image in enumerate(images):
        path = _pose_path(image)
        values = matrix(path, (4, 4)) if path.name in there else np.full((4, 4), np.nan)
        if not np.isfinite(values).all():  # the tracker was lost
            continue
        known.append(i)
        matrices.append(values)
    if not known:
        return None, len(images)
    poses = np.array(matrices)
    turns = poses[:, :3, :3]
    skewed = abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2)) > 1e-2
    wrong = np.flatnonzero(skewed | (np.linalg.det(turns) <= 0))
    if len(wrong):
        path = _pose_path(images[known[wrong[0]]])
        raise InputError(f"{path}: its first three columns are not a rotation: restore the file")
    exact = Rotation.from_matrix(poses[:, :3, :3]).as_matrix()
    return Trajectory(times_ns[known], exact, poses[:, :3, 3], "left"), len(images) - len(known)
