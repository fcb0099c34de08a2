"""The noise of an IMU, and its pose relative to a camera, from calibration files.

Noise is that of Kalibr's imu.yaml, of OpenVINS's kalibr_imu_chain.yaml (the same below `imu0`), of TUM-VI's
imu_config.yaml and of EuRoC's imu0/sensor.yaml: continuous-time densities of the same four names and units. Kalibr's
camchain-imucam.yaml and OpenVINS's kalibr_imucam_chain.yaml have the pose (T_cam_imu, cam_from_imu, or T_imu_cam) and
`timeshift_cam_imu`: t_imu = t_cam + shift [s].
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ispom.geometry import Pose
from ispom.io.calibrations.kalibr import is_camera, pose_at_imu
from ispom.io.calibrations.placed import pose_of
from ispom.io.mapping import finite_numbers, read_mapping
from ispom.io.rig import MAX_NOISE, MIN_NOISE
from ispom.types import Imu

NOISE = {
    "gyroscope_noise_density": "gyroscope_noise",
    "accelerometer_noise_density": "accelerometer_noise",
    "gyroscope_random_walk": "gyroscope_walk",
    "accelerometer_random_walk": "accelerometer_walk",
}
"""Fields of an `Imu` by the entries of files."""
TIME_OFFSET_KEY = "timeshift_cam_imu"
MAX_TIME_OFFSET_S = 10.0
"""Largest magnitude of a time offset between camera and IMU."""


def imu_noise(path: Path, content: dict[Any, Any] | None = None) -> Imu | None:
    """Returns an IMU with the noise of a file, and the default for missing values; None for a file without any. Raises
    InputError for a value that is no positive number."""
    entries: dict[Any, Any] = read_mapping(path) if content is None else content
    for inner in ("imu0", "imu"):
        if isinstance(found := entries.get(inner), dict):
            entries = found
    noise: dict[str, Any] = {
        ours: finite_numbers(path, theirs, [entries[theirs]], 1, MIN_NOISE, MAX_NOISE)[0]
        for theirs, ours in NOISE.items()
        if entries.get(theirs) is not None
    }
    return Imu(**noise) if noise else None


def body_from_imu(path: Path, content: dict[Any, Any]) -> Pose | None:
    """Returns the pose of EuRoC's sensor.yaml (T_BS); None where it has none."""
    pose = content.get("T_BS")
    if pose is None:
        return None
    return pose_of(path, "T_BS.data", pose.get("data") if isinstance(pose, dict) else pose)


def camera_from_imu(path: Path, topic: str = "") -> tuple[Pose, int] | None:
    """Returns camera_from_imu of a camchain, and the offset that converts times of the IMU to those of the camera [ns].

    The camera is that of the image `topic`, or else cam0; None where the file has no pose of an IMU. Raises InputError
    that names the invalid entry.
    """
    content = read_mapping(path)
    cameras = {key: entry for key, entry in content.items() if isinstance(key, str) and is_camera(key)}
    entries = [(key, each) for key, each in sorted(cameras.items()) if isinstance(each, dict)]
    named = [(key, each) for key, each in entries if topic and each.get("rostopic") == topic]
    for key, entry in named or entries[:1]:
        pose = pose_at_imu(path, key, entry)
        if pose is not None:
            shift = entry.get(TIME_OFFSET_KEY)
            limits = (-MAX_TIME_OFFSET_S, MAX_TIME_OFFSET_S)
            shift_s = 0.0 if shift is None else finite_numbers(path, f"{key}.{TIME_OFFSET_KEY}", [shift], 1, *limits)[0]
            return pose, -round(1e9 * shift_s)
    return None
