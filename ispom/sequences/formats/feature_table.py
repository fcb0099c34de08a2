"""A table of IMU samples and tracked points without images: `imu_and_features.csv`, as in the examples of gtsam.

Its first line names the columns. Rows of the type `imu` have `t_abs` [s], `gx gy gz` [rad/s] and `ax ay az` [m/s^2];
rows of the type `vision_feature` have `t_abs`, `landmark_id` and the undistorted normalised coordinates `u_norm v_norm`
of one point; rows of the type `meta` have `key` and `value`: the camera (`camera_fx`, ...), its pose `T_ci_*`
(body_from_camera, as EuRoC's T_BS), and perhaps `eqf.input_var_*`, the noise of the IMU. `truth.tum` beside it has the
poses of the body.

As there are no images, they are drawn: each tracked point is a round spot on black, with its own brightness. Methods
run on these images as on others; they can find no more than the tracks contain.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.io.camera import usable
from ispom.io.files import exists
from ispom.io.rig import MAX_NOISE, MIN_NOISE
from ispom.io.rows import numbers, read_text
from ispom.io.trajectories import read_tum
from ispom.io.values import LARGEST, time_ns
from ispom.sequences.matching import no_truth_note, truth_at
from ispom.sequences.readings import imu_measurements
from ispom.types import Camera, Frame, Image, Imu, Measurement, Rig, Sequence

TABLE, TRUTH = "imu_and_features.csv", "truth.tum"
COLUMNS = ("row_type", "t_abs", "landmark_id", "gx", "gy", "gz", "ax", "ay", "az", "u_norm", "v_norm", "key", "value")
CAMERA = ("camera_fx", "camera_fy", "camera_cx", "camera_cy")
POSE = tuple(f"T_ci_{name}" for name in ("tx", "ty", "tz", "qx", "qy", "qz", "qw"))
IMU_NOISE = {
    "gyroscope_noise": "eqf.input_var_gyr",
    "accelerometer_noise": "eqf.input_var_acc",
    "gyroscope_walk": "eqf.input_var_gyr_bias_walk",
    "accelerometer_walk": "eqf.input_var_acc_bias_walk",
}
"""Fields of an Imu by the keys of their squares."""
SPOT_SIGMA_PX = 2.0
"""Standard deviation of a drawn Gaussian spot [px]: corners are detected in its middle, and it fits into the tracker's
window."""
SPOT_RADIUS_PX = 8
"""Radius up to which a spot is drawn [px]: 4 standard deviations."""
WIDEST, LEAST_SHARE = 10.0, 0.9
"""Normalised coordinates of a view of 169 degrees, and the least share of points in the image where some are beyond."""
DARKEST, BRIGHTEST = 110, 250
"""Range of grey values of the spots' middles."""
MAX_SIDE_PX = 4000
"""Largest side of an image [px]; points beyond it are not drawn."""


@dataclass(frozen=True, eq=False)
class _Points:
    """The tracked points of all frames, in the order of time."""

    times_ns: NDArray[np.int64]
    ids: NDArray[np.int64]
    uv: Array
    """(N, 2), normalised."""


def looks_like_feature_table(folder: Path) -> bool:
    """Returns whether the table is there."""
    return exists(folder / TABLE)


def open_feature_table(folder: Path) -> Sequence:
    """Returns the sequence of a folder with the table. Raises InputError that names the line that is wrong."""
    path = folder / TABLE
    meta, samples, points = _read(path)
    fx, fy, cx, cy = _values(path, meta, CAMERA)
    pose = _values(path, meta, POSE)
    if fx <= 0 or fy <= 0 or not np.isclose(np.linalg.norm(pose[3:]), 1, atol=0.01):
        raise InputError(
            f"{path}: its camera needs a positive focal length and a unit quaternion: correct its meta rows"
        )
    pixels = points.uv * [fx, fy] + [cx, cy]
    near = np.asarray((np.abs(pixels - [cx, cy]) < MAX_SIDE_PX / 2).all(axis=1))
    far = float(np.abs(points.uv).max())
    if not near.any() or (far > WIDEST and near.mean() < LEAST_SHARE):
        raise InputError(
            f"{path}: u_norm and v_norm reach {far:.4g}, far outside of an image: give normalised coordinates "
            "((u - cx) / fx), not pixels"
        )
    low = np.floor(pixels[near].min(axis=0)) - SPOT_RADIUS_PX
    width, height = (np.ceil(pixels[near].max(axis=0)) + SPOT_RADIUS_PX - low + 1).astype(int).tolist()
    camera = Camera(width, height, float(fx), float(fy), float(cx - low[0]), float(cy - low[1]))
    usable(camera, f"{path}: its camera")
    noise: dict[str, Any] = {
        f: float(np.sqrt(_values(path, meta, (key,), MIN_NOISE**2, MAX_NOISE**2)[0]))
        for f, key in IMU_NOISE.items()
        if key in meta
    }
    body_from_camera = Pose.from_xyzw(pose[3:], pose[:3])
    rig = Rig.of(video=camera, rig_from_video=body_from_camera, imu=Imu(**noise))
    frames_ns, first = np.unique(points.times_ns, return_index=True)
    parts = np.split(np.arange(len(points.ids)), first[1:])

    def load(i: int) -> Measurement:
        part = parts[i]
        shown = part[near[part]]
        return Frame.video(int(frames_ns[i]), drawn(pixels[shown] - low, points.ids[shown], (width, height)))

    truth = truth_at(read_tum(folder / TRUTH), frames_ns) if exists(folder / TRUTH) else None
    notes = no_truth_note(folder / TRUTH, truth) if exists(folder / TRUTH) else ()
    about = f"{path} holds tracked points instead of images: they are drawn as spots."
    name = f"features {folder.resolve().name}"
    sequence = Sequence(name, rig, frames_ns, ("video",) * len(frames_ns), load, truth, (about, *notes))
    times_ns, values = samples
    return sequence.with_measurements(imu_measurements(times_ns, values[:, :3], values[:, 3:], frames_ns, "imu"))


def drawn(uv: Array, ids: NDArray[np.int64], size: tuple[int, int]) -> Image:
    """Returns an image (width, height) with a spot at each of (N, 2) points [px], of a brightness by its id (N,)."""
    width, height = size
    image = np.zeros((height, width))
    for (u, v), bright in zip(uv, DARKEST + (ids * 37) % (BRIGHTEST - DARKEST), strict=True):
        left, top = max(int(u) - SPOT_RADIUS_PX, 0), max(int(v) - SPOT_RADIUS_PX, 0)
        part = image[top : int(v) + SPOT_RADIUS_PX + 1, left : int(u) + SPOT_RADIUS_PX + 1]
        rows, columns = np.mgrid[top : top + part.shape[0], left : left + part.shape[1]]
        squared = (rows - v) ** 2 + (columns - u) ** 2
        np.maximum(part, bright * np.exp(-squared / (2 * SPOT_SIGMA_PX**2)), out=part)
    return np.rint(image).astype(np.uint8)


def _read(path: Path) -> tuple[dict[str, tuple[int, str]], tuple[NDArray[np.int64], Array], _Points]:
    """Returns values of meta rows by key with their lines, times (N,) and samples (N, 6) of the IMU, and points."""
    meta, stamps, samples = dict[str, tuple[int, str]](), list[int](), list[Array]()
    seen, points = list[tuple[int, int]](), list[Array]()
    for line, row in _rows(path):
        kind = row["row_type"]
        if kind == "meta":
            meta[row["key"]] = (line, row["value"])
            continue
        if kind not in ("imu", "vision_feature"):
            raise InputError(f"{path} line {line} is of the type {kind[:40]!r}, not imu, vision_feature or meta")
        stamp_ns = time_ns(f"{path} line {line}", row["t_abs"])
        earlier = stamps if kind == "imu" else [t for t, _ in seen[-1:]]
        if earlier and (stamp_ns < earlier[-1] or (kind == "imu" and stamp_ns == earlier[-1])):
            raise InputError(f"{path} line {line}: its time is not after the one before: put the lines in order")
        if kind == "imu":
            stamps.append(stamp_ns)
            samples.append(numbers(path, line, [row[name] for name in COLUMNS[3:9]]))
        else:
            seen.append((stamp_ns, int(numbers(path, line, [row["landmark_id"]])[0])))
            points.append(numbers(path, line, [row["u_norm"], row["v_norm"]]))
    if not samples or not points:
        raise InputError(f"{path} needs rows of the types imu and vision_feature: restore the file")
    both = np.array(seen, np.int64)
    found = _Points(both[:, 0], both[:, 1], np.stack(points))
    return meta, (np.array(stamps, np.int64), np.stack(samples)), found


def _rows(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """Yields each line with its number, as words by column."""
    lines = _words(path)
    _, header = next(lines, (1, []))
    if missing := [name for name in COLUMNS if name not in header]:
        raise InputError(f"{path} has no column {missing[0]} in its first line: restore it")
    for line, words in lines:
        if not words:
            continue
        if len(words) != len(header):
            raise InputError(f"{path} line {line} has {len(words)} columns, not {len(header)}: correct that line")
        yield line, dict(zip(header, words, strict=True))


def _words(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yields each line with its number, as words. Raises InputError for a field that is longer than any value."""
    line = 0
    try:
        for line, words in enumerate(csv.reader(read_text(path).splitlines()), 1):
            yield line, words
    except csv.Error:
        raise InputError(
            f"{path} line {line + 1} is no line of values separated by commas: correct that line"
        ) from None


def _values(
    path: Path,
    meta: dict[str, tuple[int, str]],
    keys: tuple[str, ...],
    least: float = -LARGEST,
    most: float = LARGEST,
) -> Array:
    """Returns numbers (K,) of meta rows, within bounds."""
    if missing := [key for key in keys if key not in meta]:
        raise InputError(f"{path} has no meta row with the key {missing[0]}: add it")
    return np.concatenate([numbers(path, meta[key][0], [meta[key][1]], least, most) for key in keys])
