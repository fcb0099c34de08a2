"""KITTI's files: poses, calibrations and times of the odometry benchmark; calibrations and GPS/IMU tracks of raw
drives."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.io.rows import increasing_times_ns, numbers, read_rows, read_text
from ispom.types import Camera, Trajectory


def read_poses(path: Path, as_printed: bool = False) -> list[Pose]:
    """Reads world_from_left from lines of 12 numbers, a (3, 4) matrix in row order; makes the rotations orthonormal.

    `as_printed` keeps the file's rounded rotations, for the same results as other programs get from them.
    """
    rows = read_rows(path, 12)
    if not rows:
        return []
    matrices = np.stack([numbers(path, line, words) for line, words in rows]).reshape(-1, 3, 4)
    rotations = matrices[:, :, :3]
    skewed = abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2)) > 1e-2
    wrong = np.flatnonzero(skewed | (np.linalg.det(rotations) <= 0))
    if len(wrong):
        line = rows[wrong[0]][0]
        raise InputError(f"{path} line {line}: its first three columns are not a rotation: correct that line")
    exact = rotations if as_printed else Rotation.from_matrix(rotations).as_matrix()
    return [Pose(rotation, matrix[:, 3]) for rotation, matrix in zip(exact, matrices, strict=True)]


def poses_text(trajectory: Trajectory) -> str:
    """Returns world_from_FRAME as such lines, without the times."""
    rows = np.concatenate([trajectory.rotations, trajectory.translations[:, :, None]], axis=2).reshape(-1, 12)
    return "".join(f"{' '.join(f'{v:.12e}' for v in row)}\n" for row in rows)


def read_times(path: Path) -> NDArray[np.int64]:
    """Reads a file with seconds as increasing times (N,) [ns]."""
    return increasing_times_ns(path, read_rows(path, 1))


def read_calibration(path: Path, cameras: tuple[str, ...] = ("P0", "P1")) -> dict[str, Array]:
    """Reads the projection matrices (3, 4) of these cameras by name; all but the first may be missing."""
    projections = {}
    for line, text in enumerate(read_text(path).splitlines(), 1):
        name, colon, values = text.partition(":")
        if name.strip() not in cameras:
            continue
        words = values.split()
        if not colon or len(words) != 12:
            raise InputError(
                f"{path} line {line}: {name.strip()} needs 12 numbers, not {len(words)}: correct that line"
            )
        matrix = numbers(path, line, words).reshape(3, 4)
        if matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
            raise InputError(f"{path} line {line}: the focal length is not positive: correct that line")
        projections[name.strip()] = matrix
    if cameras[0] not in projections:
        raise InputError(f"{path} has no line '{cameras[0]}: ...': give the calibration of this drive")
    return projections


# The text files of a KITTI raw drive: `calib_cam_to_cam.txt` and `timestamps.txt`.


_SHAPES = {"S": (2,), "K": (3, 3), "D": (5,), "S_rect": (2,), "R_rect": (3, 3), "P_rect": (3, 4)}
_STAMP = re.compile(r"(\d{4}-\d\d-\d\d \d\d:\d\d:\d\d)(?:\.(\d{1,9}))?", re.ASCII)


def read_calibrations(path: Path, cameras: tuple[str, ...]) -> list[dict[str, Array]]:
    """Reads, for each camera ("00", "01" ...), S (2,) and S_rect (2,) sizes [px], K (3, 3), D (5,), R_rect (3, 3)
    and P_rect (3, 4). Raises InputError that names the missing or invalid line."""
    rows = _named_rows(path)
    return [
        {name: _values(path, rows, f"{name}_{camera}", shape) for name, shape in _SHAPES.items()} for camera in cameras
    ]


def raw_camera(calibration: dict[str, Array]) -> Camera:
    """Returns the camera of an unrectified image."""
    fx, fy, cx, cy = calibration["K"][[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
    return Camera(*image_size(calibration["S"]), fx, fy, cx, cy, tuple(calibration["D"].tolist()))


def image_size(size: Array) -> tuple[int, int]:
    """Returns width and height of S or S_rect."""
    return int(size[0]), int(size[1])


def read_timestamps(path: Path, ordered: bool = True) -> NDArray[np.int64]:
    """Reads times (N,) [ns since 1970], increasing where `ordered`, from lines such as `2011-09-26
    13:02:25.964389445`."""
    times_ns: list[int] = []
    for line, text in enumerate(read_text(path).splitlines(), 1):
        if not text.strip():
            continue
        times_ns.append(_time_ns(path, line, text.strip()))
        if ordered and len(times_ns) > 1 and times_ns[-1] <= times_ns[-2]:
            raise InputError(f"{path} line {line}: time {text.strip()} is not after the one before: put them in order")
    return np.array(times_ns, np.int64)


def _named_rows(path: Path) -> dict[str, tuple[int, list[str]]]:
    """Returns the line number and the words of each row `NAME: ...`."""
    rows: dict[str, tuple[int, list[str]]] = {}
    for line, text in enumerate(read_text(path).splitlines(), 1):
        name, _, values = text.partition(":")
        rows[name.strip()] = (line, values.split())
    return rows


def _values(path: Path, rows: dict[str, tuple[int, list[str]]], name: str, shape: tuple[int, ...]) -> Array:
    line, words = rows.get(name, (0, []))
    if not line:
        raise InputError(f"{path} has no line '{name}: ...': give the calibration of the drive's day")
    if len(words) != np.prod(shape):
        raise InputError(
            f"{path} line {line}: {name} needs {np.prod(shape)} numbers, not {len(words)}: correct that line"
        )
    values = numbers(path, line, words).reshape(shape)
    if name[0] in "KP" and min(values[0, 0], values[1, 1]) <= 0:
        raise InputError(f"{path} line {line}: the focal length is not positive: correct that line")
    if name[0] == "S" and not ((values >= 1) & (values <= 65_536)).all():
        raise InputError(f"{path} line {line}: {name} is no size in pixels: correct that line")
    return values


def _time_ns(path: Path, line: int, text: str) -> int:
    match = _STAMP.fullmatch(text)
    try:
        moment = datetime.fromisoformat(match[1]).replace(tzinfo=UTC) if match else None
    except ValueError:
        moment = None
    if match is None or moment is None or not 1970 <= moment.year < 2115:
        raise InputError(f"{path} line {line}: '{text[:40]}' is not a date and a time: correct that line")
    return int(moment.timestamp()) * 10**9 + int((match[2] or "0").ljust(9, "0"))


EARTH_RADIUS_M = 6_378_137.0
"""Equatorial radius of WGS 84, as in the data set's own tools."""
OXTS_COLUMNS = 30
"""Number of values of each file; the first six are read: latitude, longitude [deg], altitude [m], roll, pitch, yaw
[rad]."""


def read_oxts(folder: Path) -> Trajectory:
    """Reads world_from_body of the GPS/IMU unit (`oxts/data/*.txt`, `oxts/timestamps.txt`); world: x east, y north,
    z up.

    The origin is its first position. Positions use a Mercator projection at the first latitude, as the data set's own
    tools (Geiger et al. 2013). Samples whose time is not after that of all before them are skipped. Raises InputError
    that names the invalid file.
    """
    times_ns, values = read_oxts_values(folder)
    positions = _mercator(values[:, :3])
    rotations = Rotation.from_euler("ZYX", values[:, [5, 4, 3]]).as_matrix()
    return Trajectory(times_ns, rotations, positions - positions[0], "body")


def read_oxts_values(folder: Path) -> tuple[NDArray[np.int64], Array]:
    """Reads times (N,), strictly increasing [ns], and all values (N, 30) of the GPS/IMU unit's samples.

    Samples whose time is not after that of all before them are skipped. Raises InputError that names the invalid file.
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
    return times_ns[after], values[after]


def read_rigid(path: Path) -> Pose:
    """Reads the transformation of `calib_imu_to_velo.txt` (velo_from_imu) and the like, from its lines `R:` and
    `T:`."""
    rows = _named_rows(path)
    rotation, translation = _values(path, rows, "R", (3, 3)), _values(path, rows, "T", (3,))
    if np.linalg.det(rotation) <= 0 or abs(rotation @ rotation.T - np.eye(3)).max() > 1e-2:
        raise InputError(f"{path} line {rows['R'][0]}: R is not a rotation: correct that line")
    return Pose(Rotation.from_matrix(rotation).as_matrix(), translation)


def _sample(path: Path) -> Array:
    words = read_text(path).split()
    if len(words) != OXTS_COLUMNS:
        raise InputError(f"{path} has {len(words)} values, not {OXTS_COLUMNS}: restore the file")
    values = numbers(path, 1, words)
    if abs(values[0]) >= 90 or abs(values[1]) > 360:
        raise InputError(f"{path} line 1: {words[0]} {words[1]} is not a latitude and longitude: restore the file")
    return values


def _mercator(geodetic: Array) -> Array:
    """Returns positions (N, 3) [m] of latitude, longitude [deg] and altitude [m] (N, 3)."""
    latitude, longitude = np.radians(geodetic[:, 0]), np.radians(geodetic[:, 1])
    scale = np.cos(latitude[0])
    north = EARTH_RADIUS_M * np.log(np.tan(np.pi / 4 + latitude / 2))
    return np.stack([scale * EARTH_RADIUS_M * longitude, scale * north, geodetic[:, 2]], axis=1)
