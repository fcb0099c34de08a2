"""Kalibr's camchain.yaml (cam0, cam1, ... with T_cn_cnm1, the pose of each camera after the one before), and EuRoC's
sensor.yaml.

Camchains of camera and IMU, and OpenVINS's, may have the cameras' poses at the IMU instead: T_cam_imu (cam_from_imu),
or T_imu_cam.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations.pair import pair_fault
from ispom.io.calibrations.placed import FlowDumper, Placed, camera_from, distortion_name, matrix_of, placed, pose_of
from ispom.io.camera import coefficients, lens_of
from ispom.io.mapping import finite_numbers, read_mapping

BETWEEN, OF_IMU, AT_IMU = "T_cn_cnm1", "T_cam_imu", "T_imu_cam"
SAME_POSITION_M = 1e-3
"""Largest distance between two positions of the same camera in a file."""


def kalibr_text(cameras: list[Placed], body_from_imu: Pose | None = None) -> str:
    """Writes the cameras in the given order, as a camchain-imucam with the pose of an IMU on the body of the cameras.
    Raises InputError for a rational lens, which Kalibr does not have."""
    chain: dict[str, Any] = {}
    before: Pose | None = None
    for n, each in enumerate(cameras):
        camera = each.camera
        entry: dict[str, Any] = {
            "camera_model": "pinhole",
            "distortion_model": distortion_name(camera, {"opencv": "radtan", "fisheye": "equidistant"}, "Kalibr", 4),
            "distortion_coeffs": [*camera.distortion, 0.0, 0.0, 0.0, 0.0][:4],
            "intrinsics": [camera.fx, camera.fy, camera.cx, camera.cy],
            "resolution": [camera.width, camera.height],
            "rostopic": f"/{each.name}/image_raw",
        }
        if body_from_imu is not None:
            entry["T_cam_imu"] = matrix_of(each.pose.inverse() @ body_from_imu)
        if before is not None:
            entry["T_cn_cnm1"] = matrix_of(each.pose.inverse() @ before)
        chain[f"cam{n}"] = entry
        before = each.pose
    return yaml.dump(chain, Dumper=FlowDumper, sort_keys=False, width=200)


def read_kalibr(path: Path, content: dict[Any, Any] | None = None) -> list[Placed]:
    """Reads the cameras; cam0 is the body. `content` are the file's entries, if they were read before. Raises
    InputError that names the missing or invalid entry."""
    content = read_mapping(path) if content is None else content
    names = sorted((key for key in content if isinstance(key, str) and is_camera(key)), key=lambda key: int(key[3:]))
    if not names:
        raise InputError(f"{path} holds no cam0: give a camchain of Kalibr")
    out: list[Placed] = []
    first_from_imu: Pose | None = None
    for name in names:
        entry = content[name]
        if not isinstance(entry, dict):
            raise InputError(f"{path}: {name} must hold the camera's values: correct it")
        lens = lens_of(path, entry, f"{name}.")
        size = finite_numbers(path, f"{name}.resolution", entry.get("resolution"), 2)
        intrinsics = finite_numbers(path, f"{name}.intrinsics", entry.get("intrinsics"), 4)
        distortion = coefficients(path, f"{name}.distortion_coeffs", entry.get("distortion_coeffs", []), lens)
        camera = camera_from(path, name, np.array(size), intrinsics, distortion, lens)
        from_imu = pose_at_imu(path, name, entry)
        if not out:
            first_from_imu = from_imu
        pose, notes = (Pose(), ()) if not out else _pose(path, name, entry, out[-1].pose, first_from_imu, from_imu)
        out.append(placed(path, name, name, camera, pose, notes))
    return out


def is_camera(key: str) -> bool:
    """Checks for the name of a camera: cam0, cam1 ..."""
    return key.startswith("cam") and key[3:].isascii() and key[3:].isdigit() and len(key) < 7


def _pose(
    path: Path, name: str, entry: dict[Any, Any], before: Pose, first_from_imu: Pose | None, from_imu: Pose | None
) -> tuple[Pose, tuple[str, ...]]:
    """Returns the pose of a camera in the first one, and a note where the file contradicts itself."""
    by_imu = None if first_from_imu is None or from_imu is None else first_from_imu @ from_imu.inverse()
    if entry.get(BETWEEN) is None:
        if by_imu is None:
            either = f"{BETWEEN}, or with {OF_IMU} or {AT_IMU} as all the others"
            raise InputError(f"{path}: {name} has no place: add it with {either}")
        other_way = first_from_imu.inverse() @ from_imu  # type: ignore[union-attr,operator]
        if not pair_fault(by_imu) or pair_fault(other_way):
            return by_imu, ()
        key = next(key for key in (OF_IMU, AT_IMU) if entry.get(key) is not None)
        other = AT_IMU if key == OF_IMU else OF_IMU
        return by_imu, (f"{path}: {name} would be to the right of the first camera if {key} were {other}: check which",)
    pose = before @ pose_of(path, f"{name}.{BETWEEN}", entry[BETWEEN]).inverse()
    if by_imu is None or np.abs(by_imu.matrix - pose.matrix).max() < SAME_POSITION_M:
        return pose, ()
    return pose, (f"{path}: {name} has another place by {BETWEEN} than by its pose at the IMU: the first is used",)


def pose_at_imu(path: Path, name: str, entry: dict[Any, Any]) -> Pose | None:
    """Returns camera_from_imu of a camera of a camchain; None where that has none. Raises InputError for no pose."""
    if entry.get(OF_IMU) is not None:
        return pose_of(path, f"{name}.{OF_IMU}", entry[OF_IMU])
    return pose_of(path, f"{name}.{AT_IMU}", entry[AT_IMU]).inverse() if entry.get(AT_IMU) is not None else None


# EuRoC's sensor.yaml of one camera: T_BS is body_from_camera.


def euroc_sensor_text(each: Placed, rate_hz: float | None = None) -> str:
    """Writes a camera. Raises InputError for a rational lens, which EuRoC's format does not have."""
    camera = each.camera
    name = distortion_name(camera, {"opencv": "radial-tangential", "fisheye": "equidistant"}, "EuRoC's sensor.yaml", 4)
    content: dict[str, Any] = {
        "sensor_type": "camera",
        "comment": each.name,
        "T_BS": {"cols": 4, "rows": 4, "data": each.pose.matrix.ravel().tolist()},
        **({} if rate_hz is None else {"rate_hz": rate_hz}),
        "resolution": [camera.width, camera.height],
        "camera_model": "pinhole",
        "intrinsics": [camera.fx, camera.fy, camera.cx, camera.cy],
        "distortion_model": name,
        "distortion_coefficients": [*camera.distortion, 0.0, 0.0, 0.0, 0.0][:4],
    }
    return "%YAML:1.0\n" + yaml.dump(content, Dumper=FlowDumper, sort_keys=False, width=200)


def read_euroc_sensor(path: Path, name: str = "", content: dict[Any, Any] | None = None) -> Placed:
    """Reads a camera. `content` are the file's entries, if they were read before. Raises InputError that names the
    missing or invalid entry."""
    content = read_mapping(path) if content is None else content
    lens = lens_of(path, content)
    size = finite_numbers(path, "resolution", content.get("resolution"), 2)
    intrinsics = finite_numbers(path, "intrinsics", content.get("intrinsics"), 4)
    distortion = coefficients(path, "distortion_coefficients", content.get("distortion_coefficients", []), lens)
    pose = content.get("T_BS")
    if pose is None:
        raise InputError(f"{path}: T_BS is missing: add the camera's pose")
    camera = camera_from(path, "the camera", np.array(size), intrinsics, distortion, lens)
    data = pose.get("data") if isinstance(pose, dict) else pose
    return placed(path, "", name or path.parent.name, camera, pose_of(path, "T_BS.data", data))
