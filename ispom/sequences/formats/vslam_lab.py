"""VSLAM-LAB: `rgb.csv` lists the images, `calibration.yaml` has the cameras, `groundtruth.csv` the poses of the body.

The first camera of `rgb.csv` is the left one. The second is the right one where `T_BS` puts it to the right; else the
first is read alone. Raw images of a pair are rectified here. `T_BS` is body_from_camera, as in EuRoC. Depth, masks and
`imu_0.csv` are not read. A camera of the model `unknown`, or without a calibration, gets a guessed focal length.

Layout and names: https://github.com/VSLAM-LAB/VSLAM-LAB (Datasets/DatasetVSLAMLAB.py), as of 2026.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations.pair import pair_fault
from ispom.io.calibrations.placed import Placed, camera_from, placed, pose_of
from ispom.io.camera import coefficients, lens_of
from ispom.io.files import exists, names
from ispom.io.mapping import finite_numbers, read_mapping
from ispom.io.rows import read_text
from ispom.io.trajectories import read_euroc
from ispom.io.values import nanoseconds
from ispom.sequences.guess import guess_of_photo, size_of_photo
from ispom.sequences.images import read_image, require_size, those_there
from ispom.sequences.matching import no_truth_note, truth_at
from ispom.sequences.recording import Recording
from ispom.sequences.sidecars import used
from ispom.sequences.stereo_stream import stereo_stream
from ispom.sequences.stream import Stream, size_of
from ispom.types import Found, Guess, Rig, Trajectory

LISTING, CALIBRATION, TRUTH = "rgb.csv", "calibration.yaml", "groundtruth.csv"
PATHS = re.compile(r"path_(rgb_?[0-9]+)")
"""Header of a column of image files; depth images and masks have other names."""


@dataclass(frozen=True, eq=False)
class _Sensor:
    """One camera: its calibration and its list of images."""

    placed: Placed
    times_ns: NDArray[np.int64]
    paths: list[Path]
    notes: tuple[str, ...] = ()
    guess: Guess | None = None

    def stream(self) -> Stream:
        """Returns its images, which are read on demand."""
        size = size_of(self.placed.camera)
        return Stream(self.times_ns, lambda i: read_image(self.paths[i], size), self.notes)


def looks_like_vslam_lab(folder: Path) -> bool:
    """Returns whether the list of images is there."""
    return exists(folder / LISTING)


def open_vslam_lab(folder: Path) -> Recording:
    """Returns the recording of a sequence folder. Raises InputError that names the missing or invalid file."""
    listed = _listed(folder / LISTING)
    entries = _entries(folder / CALIBRATION) if exists(folder / CALIBRATION) else {}
    name = f"VSLAM-LAB {folder.resolve().name}"
    left, *others = [_sensor(folder, camera, *columns, entries) for camera, columns in list(listed.items())[:2]]
    right, fault = (others[0], _fault(left, others[0])) if others else (None, "")
    if right is None or fault:
        truth, about = _truth(folder, left.placed.body_from_camera or Pose(), left.times_ns)
        note = (f"{folder / CALIBRATION}: {fault}: only {left.placed.name} is read",) if fault else ()
        stream, notes = left.stream(), left.notes + note + about
        camera = left.placed.camera
        found = _found(folder, truth is not None)
        return Recording(
            name, camera, None, left.times_ns, lambda _, i: stream.read(i), truth, notes, guess=left.guess, found=found
        )
    bodies = {"rig_from_left": left.placed.pose, "rig_from_right": right.placed.pose}
    rig = Rig.of(left=left.placed.camera, right=right.placed.camera, **bodies)
    stereo = stereo_stream(folder / CALIBRATION, rig, left.stream(), right.stream())
    truth, about = _truth(folder, stereo.rig.rig_from_left, stereo.times_ns)
    camera, baseline_m = stereo.rig.camera("left"), stereo.rig.baseline_m
    notes, found = stereo.notes + about, _found(folder, truth is not None)
    return Recording(name, camera, baseline_m, stereo.times_ns, stereo.read, truth, notes, found=found)


def _found(folder: Path, has_truth: bool) -> tuple[Found, ...]:
    """Returns the files that were found in the folder; an IMU is named, but not used."""
    calibration = folder / CALIBRATION
    truth = folder / TRUTH if has_truth else None
    why = "is not used: of VSLAM-LAB the cameras and the ground truth are read"
    others = [name for name in names(folder) if name.lower().startswith("imu")]
    return (
        *used(("lens", calibration if exists(calibration) else None), ("times", folder / LISTING), ("truth", truth)),
        *(Found("imu", str(folder / name), False, why) for name in others),
    )


def _listed(path: Path) -> dict[str, tuple[NDArray[np.int64], list[str]]]:
    """Returns times (N,) [ns] and files of each camera, in the order of the columns."""
    try:
        header, *rows = [row for row in csv.reader(read_text(path).splitlines()) if row] or [[]]
    except csv.Error as error:
        raise InputError(f"{path} is no list of images: {error}: give the one that VSLAM-LAB writes") from None
    header = [word.strip() for word in header]
    cameras = [match[1] for word in header if (match := PATHS.fullmatch(word))]
    if not cameras:
        raise InputError(f"{path} has no column path_rgb_0: give the list of images that VSLAM-LAB writes")
    out: dict[str, tuple[NDArray[np.int64], list[str]]] = {}
    for camera in cameras:
        stamp = f"ts_{camera} (ns)"
        if stamp not in header:
            raise InputError(f"{path} has no column '{stamp}': add the times of {camera}")
        columns = header.index(stamp), header.index(f"path_{camera}")
        times, names = [], []
        for line, row in enumerate(rows, 2):
            if len(row) != len(header):
                raise InputError(f"{path} line {line} has {len(row)} columns, not {len(header)}: correct that line")
            word, name = (row[i].strip() for i in columns)
            time_ns = nanoseconds(word)
            if time_ns is None:
                raise InputError(f"{path} line {line}: '{word[:40]}' is not a time in nanoseconds: correct that line")
            if times and time_ns <= times[-1]:
                raise InputError(f"{path} line {line}: time {word} is not after the one before: put the lines in order")
            times.append(time_ns)
            names.append(name)
        if not names:
            raise InputError(f"{path} lists no image: restore the file")
        out[camera] = np.array(times, np.int64), names
    return out


def _entries(path: Path) -> dict[str, dict[Any, Any]]:
    """Returns the entries of calibration.yaml by camera."""
    cameras = read_mapping(path).get("cameras")
    if not isinstance(cameras, list) or not all(isinstance(entry, dict) and "cam_name" in entry for entry in cameras):
        raise InputError(f"{path}: cameras is no list of cameras with a cam_name each: correct it")
    return {str(entry["cam_name"]): entry for entry in cameras}


def _sensor(
    folder: Path, name: str, times_ns: NDArray[np.int64], names: list[str], entries: dict[str, dict[Any, Any]]
) -> _Sensor:
    paths = [folder / file for file in names]
    there, notes = those_there(folder / LISTING, paths)
    times_ns, paths = times_ns[there], [paths[i] for i in there]
    entry = entries.get(name)
    if entries and entry is None:
        raise InputError(f"{folder / CALIBRATION} has no camera {name}, which {LISTING} lists: add it")
    if entry is None or entry.get("cam_model") == "unknown":
        guess, camera = guess_of_photo(paths[0])
        return _Sensor(Placed(name, camera, None), times_ns, paths, notes, guess)
    found = _placed(folder / CALIBRATION, name, entry, paths[0])
    sensor = _Sensor(found, times_ns, paths, (*found.notes, *notes))
    require_size(paths[0], size_of(found.camera))
    return sensor


def _placed(path: Path, name: str, entry: dict[Any, Any], photo: Path) -> Placed:
    """Returns a camera and its pose; the size of the images is that of `photo` where the file has none."""
    where = f"{name}."
    lens = lens_of(path, entry, where, keys=("cam_model", "distortion_type"))
    size = finite_numbers(path, f"{where}image_dimension", entry.get("image_dimension", [0, 0]), 2)
    if not any(size):  # VSLAM-LAB writes zeros where it found no image
        size = list(map(float, size_of_photo(photo)))
    focal = finite_numbers(path, f"{where}focal_length", entry.get("focal_length"), 2)
    centre = finite_numbers(path, f"{where}principal_point", entry.get("principal_point"), 2)
    key = f"{where}distortion_coefficients"
    distortion = coefficients(path, key, entry.get("distortion_coefficients", []), lens)
    camera = camera_from(path, name, np.array(size), [*focal, *centre], distortion, lens)
    pose = None if entry.get("T_BS") is None else pose_of(path, f"{where}T_BS", entry["T_BS"])
    return placed(path, name, name, camera, pose)


def _fault(left: _Sensor, right: _Sensor) -> str:
    """Returns why two cameras are no stereo pair, as a clause; empty where they are one."""
    names = f"{left.placed.name} and {right.placed.name}"
    if left.guess is not None or right.guess is not None:
        return f"{names} are not calibrated"
    if left.placed.body_from_camera is None or right.placed.body_from_camera is None:
        return f"{names} have no T_BS each"
    if fault := pair_fault(left.placed.pose.inverse() @ right.placed.pose):
        return f"T_BS does not put {right.placed.name} to the right of {left.placed.name} ({fault})"
    one, other = left.placed.camera, right.placed.camera
    return "" if size_of(one) == size_of(other) and one.lens == other.lens else f"{names} are not two equal cameras"


def _truth(
    folder: Path, body_from_left: Pose, times_ns: NDArray[np.int64]
) -> tuple[Trajectory | None, tuple[str, ...]]:
    """Returns world_from_left at the images' times, of the body's poses, and notes about it."""
    path = folder / TRUTH
    if not exists(path):
        return None, ()
    truth = truth_at(read_euroc(path, "body"), times_ns)
    return truth and truth.moved(right=body_from_left, frame="left"), no_truth_note(path, truth)
