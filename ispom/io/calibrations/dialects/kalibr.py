"""Kalibr's camchain: cam0, cam1 ... with `intrinsics` fx fy cx cy and `distortion_coeffs`; OpenVINS, TUM-VI, VI-SLAM
programs use it.

Pixel (0, 0) is the centre of the top-left pixel. Coefficients: k1 k2 p1 p2 (radtan) or k1 to k4 (equidistant).
T_cn_cnm1 is the pose of the camera before in this camera (x_n = T x_n-1), T_cam_imu is cam_from_imu, T_imu_cam its
inverse, in metres. The lenses omni, ds and eucm are not supported without a package. Source: Kalibr's wiki, "yaml
formats".
"""

from __future__ import annotations

from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import CalibrationFile, Dialect
from ispom.io.calibrations.kalibr import is_camera, read_kalibr


def _recognises(content: Content) -> bool:
    return any(map(is_camera, content.keys))


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    return CalibrationFile(content.path, read_kalibr(content.path, content.mapping))


DIALECT = Dialect(
    "kalibr", "Kalibr, OpenVINS, TUM-VI", "`camchain.yaml`", "YAML", "cam0, cam1", _recognises, _read, order=2
)
