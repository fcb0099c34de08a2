"""Settings of ORB-SLAM3 for a rig, as `ispom.io.calibrations.dialects.orbslam` reads them."""

from __future__ import annotations

from ispom.cameras import require_opencv
from ispom.errors import InputError
from ispom.types import Camera, Rig

_REST = """
ORBextractor.nFeatures: 1200
ORBextractor.scaleFactor: 1.2
ORBextractor.nLevels: 8
ORBextractor.iniThFAST: 20
ORBextractor.minThFAST: 7

Viewer.KeyFrameSize: 0.05
Viewer.KeyFrameLineWidth: 1.0
Viewer.GraphLineWidth: 0.9
Viewer.PointSize: 2.0
Viewer.CameraSize: 0.08
Viewer.CameraLineWidth: 3.0
Viewer.ViewpointX: 0.0
Viewer.ViewpointY: -0.7
Viewer.ViewpointZ: -1.8
Viewer.ViewpointF: 500.0
"""
"""Values of ORB-SLAM3's own examples, which it needs to start."""


def orbslam_text(rig: Rig, rate_hz: float) -> str:
    """Returns the file of the rectified pair, or else of the video camera. `rate_hz` is that of its images. Raises
    InputError for a lens that ORB-SLAM3 does not have."""
    camera = rig.camera("left") if rig.has_stereo else rig.camera("video")
    require_opencv(camera, "ORB-SLAM3")
    lines = ["%YAML:1.0", 'File.version: "1.0"', *_camera_lines(rig, camera)]
    lines += [f"Camera.width: {camera.width}", f"Camera.height: {camera.height}"]
    lines += [f"Camera.fps: {max(1, round(rate_hz))}", "Camera.RGB: 1"]
    if rig.has_stereo:
        lines += [f"Stereo.b: {float(rig.baseline_m)!r}", "Stereo.ThDepth: 40.0"]
    return "\n".join(lines) + "\n" + _REST


def _camera_lines(rig: Rig, camera: Camera) -> list[str]:
    values = {"fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy}
    if rig.has_stereo:
        if camera != rig.camera("right") or any(camera.distortion):
            raise InputError("settings of ORB-SLAM3 are written of a rectified pair: give a run of pairs")
        kind = "Rectified"
    elif camera.lens == "fisheye":
        kind, names = "KannalaBrandt8", ("k1", "k2", "k3", "k4")
        values |= dict(zip(names, camera.distortion, strict=False))
    elif len(camera.distortion) > 5:
        raise InputError("ORB-SLAM3 has no lens with a rational distortion: calibrate with five coefficients or fewer")
    else:
        kind, names = "PinHole", ("k1", "k2", "p1", "p2", "k3")
        values |= dict(zip(names, (*camera.distortion, *(0.0,) * 4)[: max(4, len(camera.distortion))], strict=False))
    return [f'Camera.type: "{kind}"', *(f"Camera1.{name}: {float(value)!r}" for name, value in values.items())]
