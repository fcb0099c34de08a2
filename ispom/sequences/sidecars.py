"""Sidecar files, in or beside a folder of images, or beside a film.

Files are found by the names that programs give them, in the folder and, if it has a usual name of image folders
(images, rgb, color ...), next to it. Files that are not used are reported with the reason.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError, counted
from ispom.geometry import Array
from ispom.io.files import exists, is_folder, names
from ispom.io.kitti import read_timestamps
from ispom.io.pose_table import split_line, times_in, unit_of
from ispom.io.poses.dialect import ROW_NS, TrajectoryFile, rotations_of
from ispom.io.poses.recognised import read_trajectory
from ispom.io.rows import Row, matrix, read_text
from ispom.sequences.matching import truth_at
from ispom.types import Found, Trajectory

INNER = ("images", "image", "rgb", "color", "colour", "frames", "img", "imgs", "results")
"""Usual names of image folders within the folder of a recording."""
_MODELS = ("sparse/0", "sparse", "colmap/sparse/0", ".")
CALIBRATIONS = (
    "transforms.json",
    *(f"{model}/cameras.{kind}" for model in _MODELS for kind in ("bin", "txt")),
    "camera_matrix.csv",
    "intrinsic/intrinsic_color.txt",
    *(f"intrinsics.{kind}" for kind in ("txt", "json", "yaml")),
    "K.txt",
    *(f"{name}.{kind}" for name in ("camera", "calibration") for kind in ("txt", "json", "xml")),
    "calibration.yaml",
    "camchain.yaml",
)
"""Other programs' calibrations of one camera, of which the first existing one is used; a camera.yaml has priority."""
TIMES = ("times.txt", "timestamps.txt", "timestamp.txt", "times.csv", "timestamps.csv")
POSES = (
    *(f"groundtruth.{kind}" for kind in ("txt", "csv", "tum")),
    "transforms.json",
    *(f"{model}/images.{kind}" for model in _MODELS for kind in ("bin", "txt")),
    "odometry.csv",
    "traj.txt",
    "trajectory.txt",
    "poses.txt",
    "pose",
)
"""Files of poses; `pose` is a folder with a matrix for each image, as in ScanNet."""
OTHERS = ("depth", "confidence")
"""Folders that are reported as not used; for files of other sensors see `sensors_beside`."""
IMU, IMU_TABLES = "imu.yaml", ("imu.csv", "imu.txt", "imu0.csv", "imu0/data.csv")
"""Names of the files of an IMU's noise, and of its measurements."""


def places_of(folder: Path) -> tuple[Path, ...]:
    """Returns the folders that may contain sidecar files of a folder of images."""
    real = folder.resolve()
    return (folder, real.parent) if real.name.lower() in INNER else (folder,)


def first_of(places: Sequence[Path], wanted: Sequence[str]) -> Path | None:
    """Returns the first of the wanted files that exists; None without any."""
    return next((place / name for name in wanted for place in places if exists(place / name)), None)


def used(*parts: tuple[str, Path | None]) -> tuple[Found, ...]:
    """Returns the existing files, each with its content's name, as files that are used."""
    return tuple(Found(what, str(path)) for what, path in parts if path is not None)


def not_used(places: Sequence[Path]) -> tuple[Found, ...]:
    """Returns existing files that are not used."""
    why = "is not used: the cameras' images are all that is taken of it"
    there = [
        Found("depth", str(place / name), False, why) for place in places for name in OTHERS if exists(place / name)
    ]
    if not any(exists(place / name) for place in places for name in IMU_TABLES):
        why = f"is not used: no measurements of an IMU are there ({', '.join(IMU_TABLES)})"
        there += [Found("imu", str(place / IMU), False, why) for place in places if exists(place / IMU)]
    return tuple(there)


def image_times(path: Path, count: int, image_names: Sequence[str] = ()) -> tuple[NDArray[np.int64], str]:
    """Returns increasing times (N,) [ns] of `count` images from a file with a line for each, and a note about an
    assumed unit ("" without one).

    A line is a time, or the name or number of an image and its time, in either order, optionally followed by an
    exposure time; they are separated by spaces, commas or semicolons. The unit is inferred as in `pose_table.unit_of`.
    Raises InputError that names the invalid line.
    """
    text = read_text(path)
    if re.match(r"\s*\d{4}-\d\d-\d\d \d\d:", text):
        times = read_timestamps(path)
        return _of_count(path, times, count), ""
    rows: list[Row] = []
    for line, words in enumerate(map(split_line, text.splitlines()), 1):
        if not words or words[0].startswith(("#", "%")) or (not rows and not any(map(_is_number, words))):
            continue
        if rows and len(words) != len(rows[0][1]):
            raise InputError(f"{path} line {line} has {len(words)} columns, not {len(rows[0][1])}: correct that line")
        rows.append((line, words))
    if not rows:
        raise InputError(f"{path} has no times: give one per image")
    if len(rows[0][1]) > 3:
        raise InputError(f"{path} line {rows[0][0]} has {len(rows[0][1])} columns, not 1 to 3: correct that line")
    named, column = _named_rows(rows, image_names)
    if column is None:
        column = 1 if len(rows[0][1]) > 1 and _counts(rows) else 0
    if named:
        missing = [name for name in image_names if name not in named]
        if missing:
            raise InputError(f"{path} has no time for {missing[0]}: give one per image")
        rows = [named[name] for name in image_names]
    unit = unit_of([words[column] for _, words in rows])
    times, _ = times_in(path, rows, (column,), unit)
    bad = np.flatnonzero(np.diff(times) <= 0)
    if len(bad):
        line, words = rows[bad[0] + 1]
        raise InputError(
            f"{path} line {line}: time {words[column]} is not after the one before: put the lines in order"
        )
    note = "" if unit == "s" else f"{path}: times are taken as those in {unit}, by their size or interval"
    return _of_count(path, times, count), note


def _of_count(path: Path, times: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    if len(times) != count:
        raise InputError(f"{path} has {len(times)} times for {count} images: give one per image")
    return times


def _named_rows(rows: list[Row], image_names: Sequence[str]) -> tuple[dict[str, Row], int | None]:
    """Returns the rows by the image that they name, and the column of the times; ({}, None) where they name none."""
    by_word = {Path(name).stem: name for name in image_names} | {name: name for name in image_names}
    for column, other in ((0, 1), (1, 0)):
        if len(rows[0][1]) <= column or len(rows[0][1]) == 1:
            continue
        words = [re.split(r"[/\\]", row[1][column])[-1] for row in rows]
        if len(set(words)) == len(words) and sum(word in by_word for word in words) > len(image_names) / 2:
            return {by_word[word]: row for word, row in zip(words, rows, strict=True) if word in by_word}, other
    return {}, None


def _counts(rows: list[Row]) -> bool:
    """Checks whether the first words of rows count 0, 1, 2 or 1, 2, 3."""
    first = [words[0] for _, words in rows]
    if not all(word.isascii() and word.isdigit() and len(word) <= 9 for word in first):
        return False
    return [int(word) - int(first[0]) for word in first] == [*range(len(rows))] and int(first[0]) in (0, 1)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def truth_of_images(
    path: Path, times_ns: NDArray[np.int64], image_names: Sequence[str] = (), frame: str = "left"
) -> tuple[Trajectory | None, tuple[str, ...]]:
    """Returns the ground truth at the times (N,) of images from a file of poses of any dialect, or a folder with a
    matrix for each image, and notes; None where it has none at those times.

    Poses with names of images are assigned by name; poses with times are interpolated; rows without times are assigned
    in their order. Raises InputError for an invalid or ambiguous file.
    """
    if is_folder(path) and path.name == "pose":
        return _of_pose_folder(path, times_ns, image_names, frame)
    file = read_trajectory(path)
    notes = file.notes
    if not file.has_rotations:
        return None, (*notes, f"{path} has positions only: not used as ground truth")
    if file.images:
        notes += (f"{path}: the unit of its positions is that of the model, which need not be the metre",)
    found = _at_images(file, times_ns, image_names)
    if found is None and file.timed:
        found = truth_at(file.trajectory, times_ns)
    if found is None and file.timed and len(file.trajectory) == len(times_ns):
        found = replace(file.trajectory, times_ns=times_ns)
        notes += (f"{path}: its times are none of the images, and it has a pose for each: taken row by row",)
    if found is None:
        why = "no pose at the times of the images" if file.timed else f"{len(file.trajectory)} poses without times"
        return None, (*notes, f"{path} has {why}, for {counted(len(times_ns), 'image')}: no ground truth")
    return replace(found, frame=frame), notes


def _at_images(file: TrajectoryFile, times_ns: NDArray[np.int64], image_names: Sequence[str]) -> Trajectory | None:
    if file.images and image_names:
        stems = {Path(re.split(r"[/\\]", name)[-1]).stem: i for i, name in enumerate(file.images)}
        both = [(i, stems[Path(name).stem]) for i, name in enumerate(image_names) if Path(name).stem in stems]
        if both:
            own = np.array([row for _, row in both])
            return replace(file.trajectory.select(own), times_ns=times_ns[[i for i, _ in both]])
    if file.timed:
        return None
    rows = file.trajectory.times_ns // ROW_NS
    if len(rows) == len(times_ns):
        return replace(file.trajectory, times_ns=times_ns)
    if file.numbered and len(rows) and rows[-1] < len(times_ns):
        return replace(file.trajectory, times_ns=times_ns[rows])
    return None


def _of_pose_folder(
    path: Path, times_ns: NDArray[np.int64], image_names: Sequence[str], frame: str
) -> tuple[Trajectory | None, tuple[str, ...]]:
    """Returns the poses of ScanNet's `pose/NUMBER.txt`: world_from_camera, x to the right, y down and z forward."""
    there = set(names(path))
    known: list[int] = []
    matrices: list[Array] = []
    for i, name in enumerate(image_names):
        file = f"{Path(name).stem}.txt"
        values = matrix(path / file, (4, 4)) if file in there else np.full((4, 4), np.nan)
        if np.isfinite(values).all():
            known.append(i)
            matrices.append(values)
    if not known:
        return None, (f"{path} has no pose of an image: no ground truth",)
    poses = np.array(matrices)
    rotations = rotations_of(path, [f"{Path(image_names[i]).stem}.txt" for i in known], poses[:, :3, :3])
    missing = len(image_names) - len(known)
    note = (f"{missing} of {len(image_names)} images have no pose in {path}",) if missing else ()
    return Trajectory(times_ns[known], rotations, poses[:, :3, 3], frame), note


def truth_beside(
    places: Sequence[Path], times_ns: NDArray[np.int64], image_names: Sequence[str]
) -> tuple[Trajectory | None, tuple[str, ...], tuple[Found, ...]]:
    """Returns the ground truth from a file beside images, notes about its source or the reason why it is not used, and
    the file."""
    path = first_of(places, POSES)
    if path is None:
        return None, (), ()
    try:
        truth, notes = truth_of_images(path, times_ns, image_names)
    except InputError as fault:
        return None, (), (Found("truth", str(path), False, f"is not used as ground truth: {fault.args[0]}"),)
    if truth is None:
        return None, notes[:-1], (Found("truth", str(path), False, notes[-1].removeprefix(f"{path} ")),)
    of = f"{len(truth)} of {counted(len(times_ns), 'image')}"
    note = f"ground truth of {of} is that of {path}: move it away to run without it"
    return truth, (*notes, note), (Found("truth", str(path)),)


def subtitles_found(path: Path | None) -> tuple[Found, ...]:
    """Returns the subtitles of a drone's film with positions, which are not used; empty without them."""
    if path is None:
        return ()
    try:
        count = len(read_trajectory(path).trajectory)
    except InputError:
        return ()  # subtitles of a spoken text
    why = f"has {counted(count, 'position')}: not used as ground truth, as it has no rotations; compare with them "
    return (Found("truth", str(path), False, f"{why}by ispom evaluate {path} ESTIMATE --alignment sim3"),)


def calibration_beside(
    places: Sequence[Path], readable: Callable[[Path], bool]
) -> tuple[Path | None, tuple[Found, ...]]:
    """Returns the first calibration of another program, and those files that are no calibration or not used."""
    found: tuple[Found, ...] = ()
    chosen: Path | None = None
    seen: list[Path] = []
    for path in (place / name for name in CALIBRATIONS for place in places):
        if path in seen or not exists(path) or is_folder(path):
            continue
        seen.append(path)
        if chosen is not None:
            if path.stem != chosen.stem:  # cameras.txt and cameras.bin have the same content
                why = f"is there and not used: the calibration is that of {chosen}"
                found += (Found("lens", str(path), False, why),)
            continue
        try:
            if readable(path):
                chosen = path
        except InputError as fault:
            found += (Found("lens", str(path), False, f"is not used as calibration: {fault.args[0]}"),)
    return chosen, found
