"""Agisoft Metashape (PhotoScan from 1.2): the XML of one calibration, or of a document with its sensors.

The corner of the top-left pixel is (0, 0), and cx and cy are offsets from the middle of the image (width / 2, height /
2): half a pixel is subtracted. fx = f + b1, fy = f; b2 is a skew. Coefficients k1 k2 k3 as OpenCV's; p1 is OpenCV's p2
and p2 is its p1. k4, p3 and p4 of a frame camera are not supported, nor p1, p2, b1 and b2 of a fisheye; k1 to k4 of a
fisheye are OpenCV's. Poses of single images are those of a recording. Source: Metashape Professional, user manual,
appendix "Camera models".
"""

from __future__ import annotations

from xml.etree import ElementTree

from ispom.errors import InputError
from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import CORNER_ORIGIN_PX, CalibrationFile, Dialect, lens_camera, not_supported
from ispom.io.calibrations.placed import Placed
from ispom.io.camera import MAX_SKEW
from ispom.io.values import number

PROGRAM = "Metashape"
MAX_SENSORS = 16
"""Largest number of sensors of a document."""


def _recognises(content: Content) -> bool:
    root = content.xml
    if root is None:
        return False
    if root.tag == "calibration":
        return root.find("projection") is not None or root.find("f") is not None
    return root.tag in ("document", "chunk") and next(root.iter("sensor"), None) is not None


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    path, root = content.path, content.xml
    assert root is not None  # recognised
    if root.tag == "calibration":
        return CalibrationFile(path, [_camera(content, root, path.stem, root.findtext("projection", "frame"))])
    found = []
    for sensor in list(root.iter("sensor"))[:MAX_SENSORS]:
        adjusted = [each for each in sensor.iter("calibration") if each.find("f") is not None]
        adjusted.sort(key=lambda each: each.get("class") != "adjusted")
        if adjusted:
            kind = adjusted[0].get("type", sensor.get("type", "frame"))
            found.append(_camera(content, adjusted[0], sensor.get("label", "")[:60] or "camera", kind))
    if not found:
        raise InputError(f"{path}: a file of {PROGRAM} without a calibration: export it after the cameras are aligned")
    return CalibrationFile(path, found)


def _number(content: Content, root: ElementTree.Element, key: str, default: float | None = None) -> float:
    text = root.findtext(key)
    if text is None and default is not None:
        return default
    return number(f"{content.path}: {key}", text)


def _camera(content: Content, root: ElementTree.Element, name: str, kind: str | None) -> Placed:
    path = content.path
    kind = (kind or "frame").strip().lower()
    version = f" of version {root.findtext('version')}" if root.findtext("version") else ""
    program = f"{PROGRAM}{version}"
    if root.find("f") is None and root.find("fx") is not None:
        raise not_supported(
            path, program, "fx and fy of PhotoScan before 1.2", "export the calibration again from a newer program"
        )
    if kind not in ("frame", "fisheye"):
        raise not_supported(path, program, kind[:40])
    sides = root.find("resolution")
    if sides is not None:
        width, height = (number(f"{path}: resolution.{key}", sides.get(key)) for key in ("width", "height"))
    else:
        width, height = _number(content, root, "width"), _number(content, root, "height")
    f = _number(content, root, "f")
    b1, b2, cx, cy = (_number(content, root, key, 0.0) for key in ("b1", "b2", "cx", "cy"))
    k1, k2, k3, k4 = (_number(content, root, key, 0.0) for key in ("k1", "k2", "k3", "k4"))
    p1, p2, p3, p4 = (_number(content, root, key, 0.0) for key in ("p1", "p2", "p3", "p4"))
    is_fisheye = kind == "fisheye"
    many = {"p1": p1, "p2": p2, "p3": p3, "p4": p4, "b2": b2} if is_fisheye else {"k4": k4, "p3": p3, "p4": p4}
    if used := [key for key, value in many.items() if value]:
        what = f"{', '.join(used)} of a {kind} camera"
        raise not_supported(path, program, what, f"optimise the cameras again without {', '.join(used)}")
    if abs(b2) > MAX_SKEW * abs(f):
        raise InputError(f"{path}: b2 is {b2:g} px, a skew that no sensor has: correct it")
    notes = (f"{path}: the skew of {b2:g} px (b2) is skipped, as cameras here have none",) if b2 else ()
    distortion = [k1, k2, k3, k4] if is_fisheye else [k1, k2, p2, p1, k3]
    intrinsics = [f + b1, f, width / 2 + cx, height / 2 + cy]
    lens = "fisheye" if is_fisheye else "opencv"
    return lens_camera(content, name, (width, height), intrinsics, distortion, lens, None, notes, "", CORNER_ORIGIN_PX)


DIALECT = Dialect(
    "metashape",
    "Agisoft Metashape",
    "`calibration.xml`, `cameras.xml`",
    "XML",
    "calibration with projection and f; sensor",
    _recognises,
    _read,
)
