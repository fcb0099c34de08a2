"""Open3D's camera_intrinsic.json: `width`, `height` and `intrinsic_matrix`, nine numbers by columns.

Pixel (0, 0) is the centre of the top-left pixel. There is no distortion and no pose. Source: Open3D, tutorial on RGB-D
images and PinholeCameraIntrinsic, whose matrices are written by columns.
"""

from __future__ import annotations

import numpy as np

from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import CalibrationFile, Dialect, lens_camera, several_numbers
from ispom.io.camera import intrinsics_of
from ispom.io.mapping import finite_numbers


def _recognises(content: Content) -> bool:
    values = content.mapping.get("intrinsic_matrix")
    if not isinstance(values, list) or len(values) != 9 or not {"width", "height"} <= content.keys:
        return False
    return values[2] == 0 and values[5] == 0 and bool(values[6])


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    path, values = content.path, content.mapping
    matrix = np.array(finite_numbers(path, "intrinsic_matrix", values["intrinsic_matrix"], 9)).reshape(3, 3).T
    intrinsics, notes = intrinsics_of(path, "intrinsic_matrix", matrix)
    width, height = several_numbers(path, "", values, ("width", "height"))
    camera = lens_camera(content, path.stem, (width, height), intrinsics, [], "opencv", None, notes)
    return CalibrationFile(path, [camera])


DIALECT = Dialect(
    "open3d", "Open3D", "`camera_intrinsic.json`", "JSON", "intrinsic_matrix by columns", _recognises, _read
)
