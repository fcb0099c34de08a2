"""KITTI's calib.txt of a rectified drive: lines P0: to P3: with 3 x 4 projections.

Pixel (0, 0) is the centre of the top-left pixel. Images are rectified, without distortion; the last column has -fx
times the place of the camera to the right of camera 0, in metres. P0 and P1 (grey) are left and right, or else P2 and
P3 (colour). The size is that of the images. Source: Geiger et al. 2013, "Vision meets robotics", and the devkit's
readme.
"""

from __future__ import annotations

import re

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import CalibrationFile, Dialect, lens_camera, pair, size_of_images
from ispom.io.camera import intrinsics_of
from ispom.io.rows import numbers

_LINE = re.compile(r"^P([0-3]):((?:\s+\S+){12})\s*$", re.MULTILINE)


def _recognises(content: Content) -> bool:
    return len(content.words) < 8192 and _LINE.search(content.words) is not None


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    path = content.path
    found = {
        match[1]: (content.words.count("\n", 0, match.start()) + 1, match[2]) for match in _LINE.finditer(content.words)
    }
    sides, note = size_of_images(path, size)
    names = next((pair for pair in (("0", "1"), ("2", "3")) if set(pair) <= set(found)), tuple(sorted(found))[:1])
    cameras, places = [], []
    for name in names:
        line, words = found[name]
        projection = numbers(path, line, words.split()).reshape(3, 4)
        intrinsics, _ = intrinsics_of(path, f"P{name}", projection[:, :3])
        if intrinsics[0] <= 0:
            raise InputError(f"{path} line {line}: the focal length of P{name} is not positive: correct it")
        places.append(-projection[0, 3] / intrinsics[0])
        side = "left" if name in "02" else "right"
        cameras.append(lens_camera(content, side, sides, intrinsics, [], "opencv", None, (note,), f"P{name}"))
    if len(cameras) == 1:
        return CalibrationFile(path, cameras)
    return pair(content, cameras[0], cameras[1], Pose(translation=np.array([places[1] - places[0], 0.0, 0.0])))


DIALECT = Dialect("kitti", "KITTI", "`calib.txt`", "text", "P0: with 12 numbers", _recognises, _read)
