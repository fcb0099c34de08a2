"""ISPOM's own format of one camera: width, height, fx, fy, cx, cy [px] and `distortion`.

Pixel (0, 0) is the centre of the top-left pixel. Coefficients are in OpenCV's order, or those of a fisheye lens with
`model: fisheye`; coefficients by name (k1, k2, p1 ...) are also accepted. There is no pose. Source: this documentation.
"""

from __future__ import annotations

from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import CalibrationFile, Dialect
from ispom.io.calibrations.placed import placed
from ispom.io.camera import INTRINSICS, SIZES, camera_of, skipped_note


def _recognises(content: Content) -> bool:
    return bool(content.keys & {"model", *SIZES, *INTRINSICS})


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    path, entries = content.path, content.mapping
    if size is not None and not set(SIZES) & content.keys:
        entries = entries | dict(zip(SIZES, size(), strict=True))
    camera = placed(path, "", path.stem, camera_of(path, entries), None, skipped_note(path, entries))
    return CalibrationFile(path, [camera], entries=entries)


DIALECT = Dialect(
    "ispom_camera",
    "ISPOM, one camera",
    "`camera.yaml`",
    "YAML",
    "width, height, fx, fy, cx, cy",
    _recognises,
    _read,
    order=6,
)
