"""ISPOM's own format of cameras and other sensors: `video`, `left`, `right`, each with rig_from_CAMERA.

Pixel (0, 0) is the centre of the top-left pixel; coefficients are in OpenCV's order. Poses are rig_from_CAMERA
(x_rig = R x_camera + t) in metres, quaternions x, y, z, w. Source: this documentation.
"""

from __future__ import annotations

from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import CalibrationFile, Dialect
from ispom.io.calibrations.files import placed_of
from ispom.io.calibrations.placed import placed
from ispom.io.rig import ENTRIES, read_rig
from ispom.io.values import CAMERAS
from ispom.plausibility.mounts import order_doubts


def _recognises(content: Content) -> bool:
    return bool(content.keys & set(CAMERAS)) or bool(content.keys and content.keys <= ENTRIES)


def read_placed(content: Content, every_placed: bool) -> CalibrationFile:
    """Reads a rig. Unless `every_placed`, the pose of its video camera may be missing, and is then that of the rig."""
    path, rig = content.path, read_rig(content.path, every_placed)
    cameras = [
        placed(path, p.name, p.name, p.camera, p.pose, order_doubts(str(path), p.name, p.pose)) for p in placed_of(rig)
    ]
    return CalibrationFile(path, cameras, rig)


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    return read_placed(content, True)


DIALECT = Dialect("ispom_rig", "ISPOM, a rig", "`rig.yaml`", "YAML", "video, left, right", _recognises, _read, order=1)
