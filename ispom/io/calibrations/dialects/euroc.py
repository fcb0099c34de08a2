"""EuRoC's sensor.yaml of one camera: `T_BS`, `intrinsics`, `resolution`; TUM-VI and many recorders write it.

Pixel (0, 0) is the centre of the top-left pixel. Coefficients: k1 k2 p1 p2 (radial-tangential) or k1 to k4
(equidistant). T_BS is body_from_camera, in metres. Source: Burri et al. 2016, "The EuRoC micro aerial vehicle
datasets".
"""

from __future__ import annotations

from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import CalibrationFile, Dialect
from ispom.io.calibrations.kalibr import read_euroc_sensor


def _recognises(content: Content) -> bool:
    return "T_BS" in content.keys


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    entries = content.mapping
    return CalibrationFile(content.path, [read_euroc_sensor(content.path, content=entries)], entries=entries)


DIALECT = Dialect("euroc", "EuRoC, TUM-VI", "`sensor.yaml`", "YAML", "T_BS", _recognises, _read, order=3)
