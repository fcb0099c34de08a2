"""The GPS/IMU track of a KITTI raw drive: `oxts/data/NNNNNNNNNN.txt` and `oxts/timestamps.txt`, and its place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.io.kitti_raw import read_timestamps
from ispom.io.rows import numbers, read_text
from ispom.types import Trajectory

EARTH_RADIUS_M = 6_378_137.0
COLUMNS = 30
"""Of each file; the first six are read: latitude, longitude [deg], altitude [m], roll, pitch, yaw [rad]."""


def read_oxts(folder: Path) -> Trajectory:
    """world_from_body of the unit, the world's origin at its first place, x east, y north, z up.

    Places by a Mercator projection at the first latitude, as the data set's own tools have it (Geiger et al. 2013).
    Samples whose time is not after that of all before them are skipped. InputError names the file that is wrong.
    """
    stamps = folder / "timestamps.txt"
    times_ns = read_timestamps(stamps, ordered=False)
    samples = {int(p.stem): p for p in (folder / "data").glob("*.txt") if p.stem.isascii() and p.stem.isdigit()}
    frames = sorted(samples)
    if not frames:
        raise InputError(f"{folder / 'data'} holds no sample: restore the files, or move {folder} away")
    if frames[-1] >= len(times_ns):
        raise InputError(f"{stamps} has {len(times_ns)} times, none for {samples[frames[-1]]}: give the whole file")
    values = np.stack([_sample(samples[frame]) for frame in frames])
    times_ns = times_ns[frames]
    after = np.append(True, times_ns[1:] > np.maximum.accumulate(times_ns)[:-1])
    positions = _mercator(values[:, :3])
    rotations = Rotation.from_euler("ZYX", values[:, [5, 4, 3]]).as_matrix()
    return Trajectory(times_ns[after], rotations[after], (positions - positions[0])[after], "body")


def read_rigid(path: Path) -> Pose:
    """The transformation of `calib_imu_to_velo.txt` (velo_from_imu) and the like, from its lines `R:` and `T:`."""
    lines = {}
    for line, text in enumerate(read_text(path).splitlines(), 1):
        name, _, words = text.partition(":")
        lines[name.strip()] = (line, words.split())
    rotation, translation = (_values(path, lines, name, count) for name, count in (("R", 9), ("T", 3)))
    rotation = rotation.reshape(3, 3)
    if np.linalg.det(rotation) <= 0 or abs(rotation @ rotation.T - np.eye(3)).max() > 1e-2:
        raise InputError(f"{path} line {lines['R'][0]}: R is not a rotation: correct that line")
    return Pose(Rotation.from_matrix(rotation).as_matrix(), translation)


def _values(path: Path, lines: dict[str, tuple[int, list[str]]], name: str, count: int) -> Array:
    line, words = lines.get(name, (0, []))
    if not line:
        raise InputError(f"{path} has no line '{name}: ...': give the calibration of the drive's day")
    if len(words) != count:
        raise InputError(f"{path} line {line}: {name} needs {count} numbers, not {len(words)}: correct that line")
    return numbers(path, line, words)


def _sample(path: Path) -> Array:
    words = read_text(path).split()
    if len(words) != COLUMNS:
        raise InputError(f"{path} has {len(words)} values, not {COLUMNS}: restore the file")
    values = numbers(path, 1, words[:6])
    if abs(values[0]) >= 90 or abs(values[1]) > 360:
        raise InputError(f"{path} line 1: {words[0]} {words[1]} is not a latitude and longitude: restore the file")
    return values


def _mercator(geodetic: Array) -> Array:
    """(N, 3) [m] of latitude, longitude [deg] and altitude [m] (N, 3)."""
    latitude, longitude = np.radians(geodetic[:, 0]), np.radians(geodetic[:, 1])
    scale = np.cos(latitude[0])
    north = EARTH_RADIUS_M * np.log(np.tan(np.pi / 4 + latitude / 2))
    return np.stack([scale * EARTH_RADIUS_M * longitude, scale * north, geodetic[:, 2]], axis=1)
