"""transforms.json of nerfstudio, instant-ngp and Polycam: `frames`, and `fl_x`, `fl_y`, `cx`, `cy`, `w`, `h` for all
or for each, or camera_angle_x.

In files of nerfstudio's and instant-ngp's own converters, which copy COLMAP's values, the corner of the top-left pixel
is (0, 0), so that half a pixel is subtracted. Such files are recognised by applied_transform, aabb_scale, colmap_im_id
and others. Other programs often write OpenCV's values: these are used unchanged, with a note. Coefficients by name: k1
k2 p1 p2 k3, or k1 to k4 of OPENCV_FISHEYE; k4 of another lens is that of r^8, which is not supported. If the lenses of
frames differ by up to 2 %, their median is used. The poses of the frames (world_from_camera, y up, z backwards) are
those of a recording, not of a rig. Equirectangular and orthographic cameras are not supported. Source: nerfstudio,
docs/quickstart/data_conventions and cameras/cameras.py (get_image_coords, pixel_offset 0.5).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ispom.errors import InputError
from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import (
    CORNER_ORIGIN_PX,
    CalibrationFile,
    Dialect,
    lens_camera,
    list_in,
    mapping_in,
    not_supported,
    one_number,
    several_numbers,
    size_of_images,
)

PROGRAM = "nerfstudio"
MAX_FRAMES = 20_000
"""Largest number of frames of a file."""
MAX_LENS_DIFFERENCE = 0.02
"""Largest difference of the lenses of single frames from their median, relative to the focal length."""
_FISHEYE = {"OPENCV_FISHEYE"}
_PERSPECTIVE = {"", "OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "FULL_OPENCV", "PERSPECTIVE"}
_MARKS = frozenset({"applied_transform", "applied_scale", "ply_file_path", "aabb_scale", "camera_angle_x"})
_MARKS_OF_FRAME = frozenset({"colmap_im_id", "sharpness"})
"""Entries that the programs' own converters write, from COLMAP's results or by its pixels."""
_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4")


def _recognises(content: Content) -> bool:
    frames = content.mapping.get("frames")
    if not isinstance(frames, list) or not frames or not isinstance(frames[0], dict):
        return False
    return bool({"fl_x", "fl_y", "camera_angle_x"} & (content.keys | set(frames[0])))


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    path, top = content.path, content.mapping
    frames = list_in(path, "frames", top["frames"], MAX_FRAMES)
    first = mapping_in(path, "frames[0]", frames[0])
    model = str(top.get("camera_model", first.get("camera_model", ""))).strip().upper()
    if model not in _PERSPECTIVE | _FISHEYE:
        raise not_supported(path, PROGRAM, f"camera_model {model[:40]}")
    lens = "fisheye" if model in _FISHEYE or top.get("is_fisheye") is True else "opencv"
    if {"w", "h"} <= set(top) or {"w", "h"} <= set(first):
        width, height = several_numbers(path, "", top if {"w", "h"} <= set(top) else first, ("w", "h"))
        notes: tuple[str, ...] = ()
    else:
        (width, height), note = size_of_images(path, size)
        notes = (note,)
    rows = [_lens(content, "", top, width, height)] if {"fl_x", "camera_angle_x"} & set(top) else []
    if not rows:
        each = [mapping_in(path, f"frames[{n}]", frame) for n, frame in enumerate(frames)]
        rows = [_lens(content, f"frames[{n}].", top | frame, width, height) for n, frame in enumerate(each)]
    values = np.array(rows)
    median = np.median(values, axis=0)
    if np.abs(values[:, :4] - median[:4]).max() > MAX_LENS_DIFFERENCE * median[0]:
        raise InputError(
            f"{path}: its frames have lenses that differ by more than {MAX_LENS_DIFFERENCE:.0%}: one camera is needed"
        )
    if np.abs(values - median).max() > 0:
        notes += (f"{path}: the lens differs from frame to frame: the median of {len(rows)} frames is used",)
    k1, k2, p1, p2, k3, k4 = median[4:].tolist()
    if lens == "opencv" and k4:
        raise not_supported(path, PROGRAM, f"k4 of a perspective lens ({k4:g}, of the radius to the eighth)")
    distortion = [k1, k2, k3, k4] if lens == "fisheye" else [k1, k2, p1, p2, k3]
    if lens == "fisheye" and (p1 or p2):
        raise not_supported(path, PROGRAM, "p1 and p2 of a fisheye lens")
    origin = CORNER_ORIGIN_PX
    if not _MARKS & content.keys and not _MARKS_OF_FRAME & set(first):
        origin = 0.0
        notes += (
            f"{path}: cx and cy are taken as OpenCV's, as nothing shows which program wrote them: where it was COLMAP "
            "or nerfstudio, subtract 0.5",
        )
    camera = lens_camera(
        content, path.stem, (width, height), median[:4].tolist(), distortion, lens, None, notes, "", origin
    )
    return CalibrationFile(path, [camera])


def _lens(content: Content, where: str, values: dict[Any, Any], width: float, height: float) -> list[float]:
    """Returns fx, fy, cx, cy and the coefficients."""
    path = content.path
    if "fl_x" in values:
        fx = one_number(path, where, values, "fl_x")
    else:
        angle = one_number(path, where, values, "camera_angle_x")
        if not 0.01 < angle < 3.1:
            raise InputError(f"{path}: {where}camera_angle_x is {angle:g}, no angle of view in radians: correct it")
        fx = 0.5 * width / float(np.tan(0.5 * angle))
    fy = one_number(path, where, values, "fl_y", fx)
    cx, cy = one_number(path, where, values, "cx", width / 2), one_number(path, where, values, "cy", height / 2)
    return [fx, fy, cx, cy, *several_numbers(path, where, values, _COEFFICIENTS, 0.0)]


DIALECT = Dialect(
    "nerfstudio",
    "nerfstudio, instant-ngp",
    "`transforms.json`",
    "JSON",
    "frames with fl_x or camera_angle_x",
    _recognises,
    _read,
)
