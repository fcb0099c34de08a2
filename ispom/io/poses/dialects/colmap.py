"""COLMAP's `images.txt` and `images.bin`: `IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME`, then a line of observations.

Poses are camera_from_world with w first, here inverted to world_from_camera; the camera has x to the right, y down
and z ahead; the unit is that of the model. Images are taken in the order of their names, 2 before 10, and have no
times: `--times` gives those of these images. The binary file has the same values in little endian (64-bit floats). A
folder with such a file is read, too. Source: COLMAP, documentation of the output format.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ispom.errors import InputError
from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import PoseDialect, TrajectoryFile, natural, untimed
from ispom.io.rows import numbers
from ispom.io.values import LARGEST
from ispom.types import Trajectory

TITLE, WORDS = "COLMAP", 10
_IMAGE = struct.Struct("<I7dI")
_OBSERVATION_BYTES = 24
"""Size of an observation in COLMAP's format: x, y and the id of its point."""
LONGEST_NAME, MOST_IMAGES = 1024, 1_000_000


def _recognises(content: PoseContent) -> bool:
    return _is_binary(content) or _is_text(content)


def _is_binary(content: PoseContent) -> bool:
    head = content.head
    if content.suffix != ".bin" or len(head) < 8 + _IMAGE.size:
        return False
    count, (_, *pose, _) = int.from_bytes(head[:8], "little"), _IMAGE.unpack_from(head, 8)
    return bool(0 < count <= MOST_IMAGES and abs(np.linalg.norm(pose[:4]) - 1) < 0.01)


def _is_text(content: PoseContent) -> bool:
    if not content.is_text or content.suffix not in (".txt", ""):
        return False
    if "image_id, qw, qx, qy, qz, tx, ty, tz, camera_id, name" in content.comments:
        return True
    return bool(content.rows) and _image_words(content.rows[0][1]) and _is_unit(content.rows[0][1])


def _is_unit(words: list[str]) -> bool:
    return bool(abs(np.linalg.norm([float(word) for word in words[1:5]]) - 1) < 0.01)


def _image_words(words: list[str]) -> bool:
    """Checks whether these are a line of an image: whole numbers, numbers, and a name that is none."""
    if len(words) < WORDS or not words[0].isdigit() or not words[8].isdigit():
        return False
    return all(map(_is_number, words[1:8])) and not all(map(_is_number, words[9:]))


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _read(content: PoseContent, times_ns: NDArray[np.int64] | None) -> TrajectoryFile:
    images = _of_binary(content) if _is_binary(content) else _of_text(content)
    if not images:
        raise InputError(f"{content.path} holds no image: give the model with the images that COLMAP registered")
    names = sorted(images, key=natural)
    values = np.array([images[name] for name in names])
    lengths = np.linalg.norm(values[:, :4], axis=1)
    if len(wrong := np.flatnonzero(abs(lengths - 1) > 0.01)):
        raise InputError(f"{content.path}: the quaternion of {names[wrong[0]][:80]} is not of length 1: correct it")
    rotations = Rotation.from_quat(values[:, [1, 2, 3, 0]]).inv().as_matrix()
    positions = -np.einsum("nij,nj->ni", rotations, values[:, 4:])
    times, known = untimed(content, len(names), times_ns)
    return TrajectoryFile(content.path, TITLE, Trajectory(times, rotations, positions), known, images=tuple(names))


def _of_text(content: PoseContent) -> dict[str, list[float]]:
    """Returns quaternion (w first) and translation by the name of the image."""
    path, images, observations = content.path, {}, False
    for line, text in enumerate(content.text.splitlines(), 1):
        if text.lstrip().startswith("#"):
            continue
        words = text.split()
        if observations and (not words or (len(words) % 3 == 0 and all(map(_is_number, words)))):
            observations = False
            continue
        if not words:
            continue
        if len(words) < WORDS:
            raise InputError(
                f"{path} line {line}: IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID and NAME are needed: correct "
                "that line"
            )
        name = " ".join(words[9:])
        if name in images:
            raise InputError(f"{path} line {line}: {name[:80]} is given twice: remove one")
        images[name], observations = numbers(path, line, words[1:8]).tolist(), True
    return images


def _of_binary(content: PoseContent) -> dict[str, list[float]]:
    data, path, at = content.binary, content.path, 8
    images: dict[str, list[float]] = {}
    cut = InputError(f"{path} is not a whole images.bin of COLMAP: write it again")
    for _ in range(int.from_bytes(data[:8], "little")):
        if at + _IMAGE.size > len(data):
            raise cut
        _, *pose, _ = _IMAGE.unpack_from(data, at)
        at += _IMAGE.size
        end = data.find(b"\0", at, at + LONGEST_NAME)
        if end < 0 or end + 9 > len(data):
            raise cut
        name = data[at:end].decode("utf-8", "replace")
        at = end + 9 + _OBSERVATION_BYTES * int.from_bytes(data[end + 1 : end + 9], "little")
        if at > len(data) or name in images or not name.isprintable() or not all(abs(v) <= LARGEST for v in pose):
            raise cut
        images[name] = list(pose)
    return images


DIALECT = PoseDialect(
    "colmap",
    TITLE,
    "images.txt, images.bin",
    "binary",
    "lines of a number, a quaternion, a translation, a number and a name; or the same in images.bin",
    _recognises,
    _read,
)
