"""Files of OpenCV's samples and FileStorage (YAML, XML, JSON), and ROS's camera_info: a camera matrix, coefficients,
and for a pair K1 D1 K2 D2 R T.

Pixel (0, 0) is the centre of the top-left pixel. Coefficients: k1 k2 p1 p2 [k3 [k4 k5 k6]], or k1 to k4 of the fisheye
model. R and T give x_2 = R x_1 + T; P of ROS has -fx times the baseline. Lengths are in the unit of the target, which
must be metres. Source: OpenCV's documentation of calib3d; ROS's message CameraInfo.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ispom.io.calibrations.camera_info import ImageSize, matrix_key
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import CalibrationFile, Dialect
from ispom.io.calibrations.opencv import is_xml, read_extrinsics, read_opencv, storage


def _recognises(content: Content) -> bool:
    keys = content.keys
    if is_xml(content.words):
        return True
    if matrix_key(content.mapping) or matrix_key(content.mapping, "1") or {"R", "T"} <= keys:
        return True
    return bool(keys) and "opencv-matrix" in content.words


def opencv_file(content: Content, entries: dict[Any, Any], size: ImageSize | None) -> CalibrationFile:
    """Reads entries with OpenCV's names. Raises InputError that names the missing or invalid one."""
    second = read_extrinsics(content.path, entries)
    cameras = [] if second is not None else read_opencv(content.path, size, entries)
    of_pair = len(cameras) == 1 and cameras[0].body_from_camera is not None
    return CalibrationFile(content.path, cameras, second=second, is_relative=True, of_pair=of_pair)


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    if is_xml(content.words):
        return opencv_file(content, storage(content.path), size)
    return replace(opencv_file(content, content.mapping, size), entries=content.mapping)


DIALECT = Dialect(
    "opencv",
    "OpenCV, ROS",
    "`calibration.yml`, `ost.yaml`, `intrinsics.xml`",
    "YAML",
    "camera_matrix or K; K1, M1; R and T",
    _recognises,
    _read,
    order=4,
)
