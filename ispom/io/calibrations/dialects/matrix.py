"""A bare camera matrix as text or CSV: K (3 x 3), or a 3 x 4 or 4 x 4 matrix with zeros in the last column.

Pixel (0, 0) is the centre of the top-left pixel. The size is that of the images; there is no distortion and no pose. A
matrix whose last row has the principal point is MATLAB's IntrinsicMatrix, which counts pixels from 1. Files: K.txt of
the VAMR course, intrinsic_color.txt of ScanNet, camera_matrix.csv of Stray Scanner. Source: ScanNet's README; Stray
Scanner's docs/format.md; MATLAB's documentation of cameraIntrinsics.
"""

from __future__ import annotations

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import CalibrationFile, Dialect, lens_camera, size_of_images
from ispom.io.camera import intrinsics_of

MATLAB_ORIGIN_PX = 1.0
"""MATLAB's coordinates of the centre of the top-left pixel, which is (0, 0) here."""
_SHAPES = ((3, 3), (3, 4), (4, 4))


def _matrix(content: Content) -> Array | None:
    matrix = content.matrix
    if matrix is None:
        return None
    if matrix.size in (9, 12, 16) and 1 in matrix.shape:
        return matrix.reshape({9: (3, 3), 12: (3, 4), 16: (4, 4)}[matrix.size])
    return matrix if matrix.shape in _SHAPES else None


def _recognises(content: Content) -> bool:
    matrix = _matrix(content)
    return matrix is not None and min(matrix[0, 0], matrix[1, 1]) > 1.5  # rotations have at most 1


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    matrix = _matrix(content)
    assert matrix is not None  # recognised
    return matrix_file(content, matrix, size)


def matrix_file(
    content: Content, matrix: Array, size: ImageSize | None, distortion: tuple[float, ...] = ()
) -> CalibrationFile:
    """Reads K, or a projection whose last column is 0. Raises InputError for a matrix with a rotation or a baseline."""
    path = content.path
    if matrix.shape == (4, 4) and np.abs(matrix[3] - (0, 0, 0, 1)).max() > 1e-9:
        raise InputError(f"{path}: the last row of a 4 x 4 matrix is not 0 0 0 1: give the camera matrix alone")
    if matrix.shape[1] == 4 and np.abs(matrix[:3, 3]).max() > 1e-9:
        raise InputError(
            f"{path}: the last column of the matrix is not 0: it has a pose or a baseline, too. Give the camera matrix "
            "alone, or both of a pair as OpenCV or ROS write them"
        )
    k, origin, notes = matrix[:3, :3], 0.0, ()
    if not k[:2, 2].any() and k[2, 2] == 1 and k[2, :2].any():
        k, origin = k.T, MATLAB_ORIGIN_PX
        notes = (f"{path}: its last row has the principal point, as in MATLAB: pixels are counted from 1 in it",)
    intrinsics, about = intrinsics_of(path, "the matrix", k)
    sides, note = size_of_images(path, size)
    camera = lens_camera(
        content, path.stem, sides, intrinsics, list(distortion), "opencv", None, (*notes, *about, note), "", origin
    )
    return CalibrationFile(path, [camera])


DIALECT = Dialect(
    "matrix",
    "A bare camera matrix (ScanNet, Stray Scanner, VAMR)",
    "`K.txt`, `intrinsic_color.txt`, `camera_matrix.csv`",
    "text",
    "3 x 3, 3 x 4 or 4 x 4 numbers",
    _recognises,
    _read,
)
