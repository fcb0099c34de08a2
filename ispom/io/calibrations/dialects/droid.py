"""DROID-SLAM, DPVO and DPV-SLAM: one line of numbers, fx fy cx cy, and optionally the coefficients.

Pixel (0, 0) is the centre of the top-left pixel. Coefficients: k1 k2 p1 p2 [k3 [k4 k5 k6]], in the order of
cv2.undistort. The size is that of the images; there is no pose. Source: DROID-SLAM, demo.py and calib/.
"""

from __future__ import annotations

from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import CalibrationFile, Dialect, lens_camera, size_of_images


def _row(content: Content) -> list[float] | None:
    rows = content.rows
    if rows is None:
        return None
    row = rows[0] if len(rows) == 1 else [row[0] for row in rows] if all(len(row) == 1 for row in rows) else []
    # Nine numbers are a matrix where the third last is that of its last row.
    is_matrix = len(row) == 9 and row[8] == 1
    return row if len(row) in (4, 8, 9, 12) and not is_matrix and min(row[:4]) > 1.5 else None


def _recognises(content: Content) -> bool:
    return _row(content) is not None


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    row = _row(content) or []
    sides, note = size_of_images(content.path, size)
    camera = lens_camera(content, content.path.stem, sides, row[:4], row[4:], "opencv", None, (note,))
    return CalibrationFile(content.path, [camera])


DIALECT = Dialect(
    "droid",
    "DROID-SLAM, DPVO",
    "`calib.txt`, `tum3.txt`",
    "text",
    "one line: fx fy cx cy and 0, 4, 5 or 8 coefficients",
    _recognises,
    _read,
)
