"""4Seasons: the folder of a recording, with `undistorted_images/cam0`, `cam1` and `GNSSPoses.txt`.

The undistorted images are rectified. Their camera and baseline are those of `undistorted_calib_0.txt` and
`undistorted_calib_stereo.txt` in the folder `calibration` in or beside the recording; names of images are their times
in nanoseconds. The ground truth is `GNSSPoses.txt`: keyframes, world_from_left after a multiplication by the scale in
its ninth column. `result.txt`, a program's estimate, is not used. Written from public documentation: the page
"documentation" of the data set, and kapture's importer.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ispom.errors import InputError
from ispom.io.calibrations.recognised import one_camera
from ispom.io.files import exists
from ispom.io.rows import matrix, numbers, read_text
from ispom.sequences.formats.folder import folder_stream, holds_images, named_images
from ispom.sequences.recording import Recording, Side
from ispom.sequences.stereo_stream import level_pair
from ispom.sequences.stream import Clock, Stream, size_of
from ispom.types import Trajectory

IMAGES, CALIBRATION, POSES = "undistorted_images", "calibration", "GNSSPoses.txt"
POSE_COLUMNS = 9
"""Number of columns of a pose: the image's name, position, quaternion, scale; further columns are ignored."""
SIDES: dict[Side, str] = {"left": "cam0", "right": "cam1"}


def looks_like_four_seasons(folder: Path) -> bool:
    """Checks whether a folder has the undistorted left images."""
    return holds_images(folder / IMAGES / SIDES["left"])


def open_four_seasons(folder: Path) -> Recording:
    """Returns the recording of such a folder. Raises InputError that names the missing or invalid file."""
    real = folder.resolve()
    places = [place / CALIBRATION for place in (real, real.parent, real.parent.parent)]
    calibration = next((place for place in places if exists(place / "undistorted_calib_0.txt")), None)
    if calibration is None:
        raise InputError(f"{places[1]} is missing: put the folder calibration of the data set there")
    camera = one_camera(calibration / "undistorted_calib_0.txt")[0]
    streams: dict[Side, Stream] = {
        side: folder_stream(folder / IMAGES / name, size_of(camera), Clock(), named_images(folder / IMAGES / name))
        for side, name in SIDES.items()
        if holds_images(folder / IMAGES / name)
    }
    baseline_m = _baseline_m(calibration / "undistorted_calib_stereo.txt") if "right" in streams else None
    times_ns, read, notes = level_pair(folder, streams)
    path = folder / POSES
    truth = _truth(path) if exists(path) else None
    if truth is not None:
        truth = truth.select(np.isin(truth.times_ns, times_ns))
        notes += (f"{path} has the pose of {len(truth)} of {len(times_ns)} images, its keyframes",)
    return Recording(f"4Seasons {real.name}", camera, baseline_m, times_ns, read, truth, notes)


def _baseline_m(path: Path) -> float:
    pose = matrix(path, (4, 4))
    baseline_m = float(abs(pose[0, 3]))
    turned = abs(pose[:3, :3] - np.eye(3)).max() > 1e-6
    if not np.isfinite(pose).all() or turned or abs(pose[1:3, 3]).max() > 1e-6 * baseline_m or baseline_m == 0:
        raise InputError(f"{path} is not that of a rectified pair, one camera beside the other: restore the file")
    return baseline_m


def _truth(path: Path) -> Trajectory:
    values = []
    for line, text in enumerate(read_text(path).splitlines(), 1):
        words = text.replace(",", " ").split()
        if not words or not words[0].isdigit():  # the header
            continue
        if len(words) < POSE_COLUMNS:
            raise InputError(
                f"{path} line {line} has {len(words)} columns, not {POSE_COLUMNS} or more: correct that line"
            )
        row = numbers(path, line, words[1:POSE_COLUMNS])
        if abs(np.linalg.norm(row[3:7]) - 1) > 0.01 or row[7] <= 0:
            raise InputError(f"{path} line {line}: its quaternion is not of length 1, or its scale not positive")
        if len(words[0]) > 19 or (values and int(words[0]) <= values[-1][0]):
            raise InputError(f"{path} line {line}: {words[0][:40]} is not after the one before: put the lines in order")
        values.append((int(words[0]), row))
    if not values:
        raise InputError(f"{path} has no pose: restore the file, or move it away to run without truth")
    rows = np.array([row for _, row in values])
    times_ns = np.array([time_ns for time_ns, _ in values], np.int64)
    return Trajectory(times_ns, Rotation.from_quat(rows[:, 3:7]).as_matrix(), rows[:, :3] * rows[:, 7:], "left")
