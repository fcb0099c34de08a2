"""A simulated recording as a raw drive of KITTI: rectified pairs, and a GPS/IMU unit in place of the IMU."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from ispom.geometry import Pose
from ispom.sequences.sensor_doubts import readings_of
from ispom.types import Sequence, is_stereo

START_S = 1_317_042_145
ORIGIN = (49.0, 8.4, 116.0)
LOCAL_FROM_WORLD = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""East, north, up of right, down, ahead."""
ACCURACY_M = 0.05


def stamp(time_ns: int) -> str:
    seconds, rest = divmod(time_ns, 10**9)
    return f"{datetime.fromtimestamp(START_S + seconds, UTC):%Y-%m-%d %H:%M:%S}.{rest:09d}"


def write_drive(root: Path, sequence: Sequence) -> Path:
    """Writes the pairs and the unit, whose positions are exact, and gives the drive."""
    rig, truth = sequence.rig, sequence.truth
    assert truth is not None and rig.left is not None
    drive = root / "2011_09_26" / "2011_09_26_drive_0001_extract"
    pairs = [m for m in (sequence[i] for i in range(len(sequence))) if is_stereo(m)]
    for camera, side in (("00", "left"), ("01", "right")):
        (drive / f"image_{camera}" / "data").mkdir(parents=True)
        for k, pair in enumerate(pairs):
            cv2.imwrite(str(drive / f"image_{camera}" / "data" / f"{k:010d}.png"), pair.images[side])
        times = "\n".join(stamp(pair.time_ns) for pair in pairs)
        (drive / f"image_{camera}" / "timestamps.txt").write_text(f"{times}\n")
    lens, lines = rig.left, []
    for k, camera in enumerate(("00", "01")):
        matrix = f"{lens.fx} 0 {lens.cx} 0 {lens.fy} {lens.cy} 0 0 1"
        lines += [f"S_{camera}: {lens.width} {lens.height}", f"K_{camera}: {matrix}", f"D_{camera}: 0 0 0 0 0"]
        lines += [f"R_rect_{camera}: 1 0 0 0 1 0 0 0 1", f"S_rect_{camera}: {lens.width} {lens.height}"]
        shift = -lens.fx * rig.baseline_m * k
        lines.append(f"P_rect_{camera}: {lens.fx} 0 {lens.cx} {shift} 0 {lens.fy} {lens.cy} 0 0 0 1 0")
    (drive.parent / "calib_cam_to_cam.txt").write_text("\n".join(lines) + "\n")
    velo = Pose(np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]), np.array([0.0, -0.1, -0.3]))
    unit = velo.inverse() @ rig.rig_from_left.inverse() @ rig.rig_from("imu")
    for name, pose in (("calib_velo_to_cam", velo), ("calib_imu_to_velo", unit)):
        rows = [" ".join(map(repr, values.ravel().tolist())) for values in (pose.rotation, pose.translation)]
        (drive.parent / f"{name}.txt").write_text(f"R: {rows[0]}\nT: {rows[1]}\n")
    _write_unit(drive / "oxts", sequence)
    return drive


def _write_unit(oxts: Path, sequence: Sequence) -> None:
    truth, imu = sequence.truth, readings_of(sequence)["imu"]
    assert truth is not None
    (oxts / "data").mkdir(parents=True)
    placed = truth.moved(right=sequence.rig.rig_from("imu"), frame="imu")
    at = np.clip(imu.times_ns, placed.times_ns[0], placed.times_ns[-1]) * 1e-9
    positions = CubicSpline(placed.times_ns * 1e-9, placed.translations)(at) @ LOCAL_FROM_WORLD.T
    turned = RotationSpline(placed.times_ns * 1e-9, Rotation.from_matrix(placed.rotations))(at)
    yaw, pitch, roll = (Rotation.from_matrix(LOCAL_FROM_WORLD) * turned).as_euler("ZYX").T
    pymap3d = pytest.importorskip("pymap3d", reason="the extra `fusion` is not installed")
    east, north, up = positions.T
    latitude, longitude, height = pymap3d.enu2geodetic(east, north, up, *ORIGIN)
    rows = np.zeros((len(at), 30))
    rows[:, :6] = np.stack([latitude, longitude, height, roll, pitch, yaw], axis=1)
    rows[:, 11:14], rows[:, 17:20], rows[:, 23] = imu.values["forces"], imu.values["rates"], ACCURACY_M
    for k, row in enumerate(rows.tolist()):
        (oxts / "data" / f"{k:010d}.txt").write_text(" ".join(map(repr, row)) + "\n")
    (oxts / "timestamps.txt").write_text("\n".join(stamp(int(t)) for t in imu.times_ns) + "\n")
