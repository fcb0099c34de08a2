"""Rotation matrices in files: rounded as files are, made orthonormal here."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Array

ROUNDED = 1e-3
"""By so much a rotation in a file may not be one, whatever its digits: other programs compute with few."""
EXACT = 1e-12
"""Rotations nearer than this to one are taken as they stand."""
_SHARE = 2.0
"""Rounding moves each value by half of its last digit, and so R R^T by up to sqrt(3) of one."""


def rotation_of(path: Path, where: str, matrix: Array) -> Array:
    """The rotation (3, 3) nearest to a matrix (3, 3); InputError where its rounding does not explain the difference."""
    away = float(np.abs(matrix @ matrix.T - np.eye(3)).max())
    if away > max(ROUNDED, _SHARE * 10.0 ** -_decimals(matrix)) or np.linalg.det(matrix) <= 0:
        raise InputError(f"{path}: {where} is no rotation (its rows are not of length 1 at right angles): correct it")
    if away <= EXACT:
        return matrix
    u, _, vt = np.linalg.svd(matrix)
    return u @ vt


def _decimals(matrix: Array) -> int:
    """Digits after the point of the value that has most of them; 2 at least, as with fewer nothing would be known."""
    words = [np.format_float_positional(value, trim="-") for value in np.ravel(matrix)]
    return max(2, *(len(word.partition(".")[2]) for word in words))
