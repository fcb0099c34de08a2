"""transforms.json of nerfstudio, as `ispom.io.calibrations.dialects.nerfstudio` and the poses' dialect read it."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np

from ispom.cameras import require_opencv
from ispom.errors import InputError
from ispom.io.calibrations.dialect import CORNER_ORIGIN_PX
from ispom.io.poses.dialect import FLIP
from ispom.types import Camera, Trajectory


def transforms_text(camera: Camera, poses: Trajectory, name_of: Callable[[int], str]) -> str:
    """Returns the file of images with one camera; `poses` are world_from_camera, `name_of` gives the name of the image
    at a time [ns].

    The corner of the top-left pixel is (0, 0) there, which `applied_transform` (the identity) indicates; a camera has
    its y axis up and z backwards. Raises InputError for a lens that nerfstudio does not have.
    """
    require_opencv(camera, "nerfstudio")
    names = ("k1", "k2", "k3", "k4") if camera.lens == "fisheye" else ("k1", "k2", "p1", "p2", "k3")
    if len(camera.distortion) > len(names):
        raise InputError("nerfstudio has no lens with a rational distortion: calibrate with five coefficients or fewer")
    coefficients = dict(zip(names, (*camera.distortion, *(0.0,) * len(names)), strict=False))
    matrices = np.tile(np.eye(4), (len(poses), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = poses.rotations @ FLIP, poses.translations
    frames = [
        {"file_path": name_of(time_ns), "transform_matrix": matrix}
        for time_ns, matrix in zip(poses.times_ns.tolist(), matrices.tolist(), strict=True)
    ]
    content = {
        "camera_model": "OPENCV_FISHEYE" if camera.lens == "fisheye" else "OPENCV",
        "fl_x": camera.fx,
        "fl_y": camera.fy,
        "cx": camera.cx + CORNER_ORIGIN_PX,
        "cy": camera.cy + CORNER_ORIGIN_PX,
        "w": camera.width,
        "h": camera.height,
        **coefficients,
        "applied_transform": np.eye(4)[:3].tolist(),
        "frames": frames,
    }
    return json.dumps(content, indent=1)
