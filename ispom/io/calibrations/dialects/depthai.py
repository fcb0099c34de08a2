"""Luxonis' DepthAI: the JSON of a device's memory with `cameraData`, a list of sockets and cameras.

Pixel (0, 0) is the centre of the top-left pixel. Coefficients: OpenCV's 14 of a perspective lens (cameraType 0), of
which thin prism and tilt must be 0, or k1 to k4 of a fisheye (cameraType 1). extrinsics are toCameraSocket_from_camera
(x_to = R x + t), in centimetres. CAM_B (socket 1) and CAM_C (socket 2) are left and right, CAM_A (socket 0) is the
video camera, and where one camera is needed it is CAM_A. Source: depthai-core, common/Extrinsics.hpp and
CalibrationHandler.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations.camera_info import ImageSize, values
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import (
    CalibrationFile,
    Dialect,
    lens_camera,
    list_in,
    mapping_in,
    not_supported,
    several_numbers,
)
from ispom.io.calibrations.placed import Placed, rotation_of
from ispom.io.camera import intrinsics_of
from ispom.io.mapping import finite_numbers

METRES_PER_CENTIMETRE = 1e-2
_ROLES = {0: "video", 1: "left", 2: "right"}
_TYPES = {0: "opencv", 1: "fisheye"}


def _recognises(content: Content) -> bool:
    return isinstance(content.mapping.get("cameraData"), list)


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    path = content.path
    data: dict[int, dict[Any, Any]] = {}
    for n, entry in enumerate(list_in(path, "cameraData", content.mapping["cameraData"])):
        if not isinstance(entry, list) or len(entry) != 2 or not isinstance(entry[0], int):
            raise InputError(f"{path}: cameraData[{n}] is not a socket and its camera: correct it")
        data[entry[0]] = mapping_in(path, f"cameraData[{n}]", entry[1])
    sockets = [socket for socket in (1, 2, 0) if socket in data and _is_calibrated(data[socket])]
    if not sockets:
        raise InputError(f"{path}: none of its cameras is calibrated: read the device's memory again")
    cameras = [_camera(content, socket, data[socket]) for socket in sockets]
    poses = [_to_end(content, socket, data) for socket in sockets]
    ends = {end for end, _ in poses}
    if len(sockets) == 1 or len(ends) > 1:
        return CalibrationFile(path, cameras)
    first = poses[0][1].inverse()
    cameras = [each.at(first @ pose) for each, (_, pose) in zip(cameras, poses, strict=True)]
    return CalibrationFile(path, cameras, is_relative=True, usual="video" if 0 in sockets else "")


def _is_calibrated(camera: dict[Any, Any]) -> bool:
    matrix = camera.get("intrinsicMatrix")
    return isinstance(matrix, list) and bool(matrix) and camera.get("width", 0) != 0


def _camera(content: Content, socket: int, camera: dict[Any, Any]) -> Placed:
    path, where = content.path, f"the camera of socket {socket}"
    kind = camera.get("cameraType", 0)
    if kind not in _TYPES:
        raise not_supported(path, "DepthAI", f"cameraType {str(kind)[:20]}")
    width, height = several_numbers(path, f"{where}: ", camera, ("width", "height"))
    matrix = values(path, f"intrinsicMatrix of {where}", camera.get("intrinsicMatrix"), 9).reshape(3, 3)
    intrinsics, notes = intrinsics_of(path, f"intrinsicMatrix of {where}", matrix)
    listed = camera.get("distortionCoeff") or []
    coefficients = finite_numbers(path, f"distortionCoeff of {where}", listed, (0, 4, 5, 8, 12, 14))
    return lens_camera(
        content, _ROLES[socket], (width, height), intrinsics, coefficients, _TYPES[kind], None, notes, where
    )


def _to_end(content: Content, socket: int, data: dict[int, dict[Any, Any]]) -> tuple[int, Pose]:
    """Returns the last camera of the chain of extrinsics, and last_from_socket."""
    pose, seen = Pose(), {socket}
    while True:
        extrinsics = data[socket].get("extrinsics")
        extrinsics = extrinsics if isinstance(extrinsics, dict) else {}
        to = extrinsics.get("toCameraSocket", -1)
        if not isinstance(to, int) or to not in data or to in seen:
            return socket, pose
        where = f"extrinsics of socket {socket}"
        rotation = values(content.path, f"rotationMatrix of {where}", extrinsics.get("rotationMatrix"), 9)
        rotation = rotation_of(content.path, f"rotationMatrix of {where}", rotation.reshape(3, 3))
        place = mapping_in(content.path, f"translation of {where}", extrinsics.get("translation"))
        translation = several_numbers(content.path, f"translation of {where}: ", place, ("x", "y", "z"))
        pose = Pose(rotation, METRES_PER_CENTIMETRE * np.array(translation)) @ pose
        seen.add(to)
        socket = to


DIALECT = Dialect("depthai", "Luxonis DepthAI", "`calib.json`", "JSON", "cameraData", _recognises, _read)
