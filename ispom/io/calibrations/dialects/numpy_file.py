"""NumPy's .npz and .npy: a camera matrix (`mtx`, `K`, `camera_matrix` ...), `dist`, and for a pair K1 D1 K2 D2 R T.

Pixel (0, 0) is the centre of the top-left pixel. Names, coefficients and poses are those of OpenCV's files, as its
tutorials save them with np.savez; lengths are in the unit of the target. An .npy is a matrix alone, and the size is
that of the images where the file has none. Pickled objects are not read. Source: OpenCV's tutorial on camera
calibration in Python; numpy.lib.format.
"""

from __future__ import annotations

import zipfile
import zlib
from io import BytesIO
from typing import Any

import numpy as np
from numpy.lib import format as npy

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.calibrations.camera_info import ImageSize, matrix_key
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import CalibrationFile, Dialect
from ispom.io.calibrations.dialects.matrix import matrix_file
from ispom.io.calibrations.dialects.opencv import opencv_file

_MAGIC, _ZIP, _PICKLE = b"\x93NUMPY", b"PK\x03\x04", (b"\x80\x02", b"\x80\x03", b"\x80\x04", b"\x80\x05")
MAX_ARRAYS, MAX_VALUES = 200, 256
"""Largest number of arrays of an .npz, and of values of an array that is read: larger ones are corners or images."""


def _recognises(content: Content) -> bool:
    return content.data.startswith((_MAGIC, _ZIP, *_PICKLE))


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    path = content.path
    if content.data.startswith(_PICKLE):
        raise InputError(f"{path} is a pickle, which could run any program and is not read: save it with np.savez")
    if content.data.startswith(_MAGIC):
        matrix = _array(content, path.name, content.data)
        if matrix is None or matrix.shape not in ((3, 3), (3, 4), (4, 4)):
            shape = (
                "other values" if matrix is None else f"an array of {' x '.join(map(str, matrix.shape)) or 'one value'}"
            )
            raise InputError(f"{path} holds {shape}, not a camera matrix (3 x 3): give the right file")
        return matrix_file(content, matrix, size)
    entries = _entries(content)
    if matrix_key(entries) is None and matrix_key(entries, "1") is None and not {"R", "T"} <= set(entries):
        names = ", ".join(sorted(entries)[:12]) or "nothing"
        raise InputError(f"{path} holds {names}, but no camera matrix: save it as camera_matrix, K or mtx")
    return opencv_file(content, entries, size)


def _entries(content: Content) -> dict[Any, Any]:
    """Returns the small arrays of an archive as lists, by name."""
    path, entries = content.path, {}
    try:
        with zipfile.ZipFile(BytesIO(content.data)) as archive:
            members = archive.infolist()
            if len(members) > MAX_ARRAYS:
                raise InputError(
                    f"{path} holds {len(members)} arrays, more than a calibration has: give the right file"
                )
            for member in members:
                if not member.filename.endswith(".npy") or member.flag_bits & 1:
                    continue
                with archive.open(member) as file:
                    head = file.read(8 * MAX_VALUES + 4096)  # bounded, as the length in the archive may be wrong
                array = _array(content, member.filename, head)
                if array is not None:
                    entries[member.filename.removesuffix(".npy")] = array.tolist()
    except (zipfile.BadZipFile, EOFError, OSError, ValueError, RuntimeError, NotImplementedError, zlib.error) as fault:
        raise InputError(f"{path} is not a whole .npz file ({type(fault).__name__}): save it again") from None
    return entries


def _array(content: Content, name: str, data: bytes) -> Array | None:
    """Returns the array of the bytes of an .npy; None for a large one, and for one without numbers. Raises InputError
    for Python objects, and for damaged bytes."""
    wrong = InputError(f"{content.path}: {name[:60]} is not a whole array: save it again")
    file = BytesIO(data)
    try:
        version = npy.read_magic(file)
        if version not in ((1, 0), (2, 0), (3, 0)):
            raise wrong
        read_header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, in_columns, dtype = read_header(file, max_header_size=4096)
    except Exception:  # its parser of headers raises errors of many kinds
        raise wrong from None
    if dtype.hasobject:
        raise InputError(
            f"{content.path}: {name[:60]} holds Python objects, which could run any program and are not read: save the "
            "matrices with np.savez"
        )
    count = int(np.prod(shape, dtype=object)) if shape else 1
    if not 0 <= count <= MAX_VALUES or dtype.kind not in "iuf" or dtype.itemsize > 8:
        return None
    values = file.read(count * dtype.itemsize)
    if len(values) < count * dtype.itemsize:
        raise wrong
    array = np.frombuffer(values, dtype, count).astype(float)
    return array.reshape(shape, order="F" if in_columns else "C")


DIALECT = Dialect(
    "numpy_file",
    "NumPy",
    "`calibration.npz`, `K.npy`",
    "binary",
    "an .npz with mtx, K or camera_matrix; an .npy",
    _recognises,
    _read,
)
