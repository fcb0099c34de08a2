"""360-degree images of a simulated place, from pinhole views of it that cover the sphere."""

from __future__ import annotations

import cv2
import numpy as np

from ispom.cameras import Camera, Equirectangular
from ispom.geometry import Pose, so3_exp
from ispom.simulation.rendering.renderer import Renderer
from ispom.types import Image

HALF_VIEW = 1.1
"""Tangent of half the field of view of a pinhole view: their edges overlap."""
QUARTER = np.pi / 2
TURNS = [so3_exp(np.array(v) * QUARTER) for v in ((0, 0, 0), (0, 1, 0), (0, 2, 0), (0, 3, 0), (1, 0, 0), (-1, 0, 0))]


def panorama(renderer: Renderer, world_from_camera: Pose, width: int) -> Image:
    """Returns the image (width / 2, width, 3), without noise."""
    camera = Equirectangular.camera(width, width // 2)
    side = width // 2
    view = Camera(side, side, side / 2 / HALF_VIEW, side / 2 / HALF_VIEW, (side - 1) / 2, (side - 1) / 2)
    u, v = np.meshgrid(np.arange(float(camera.width)), np.arange(float(camera.height)))
    rays, _ = camera.unproject(np.stack([u.ravel(), v.ravel()], axis=1))
    out = np.zeros((camera.height, camera.width, 3), np.float32)
    ahead = np.argmax([(rays @ turn)[:, 2] for turn in TURNS], axis=0).reshape(out.shape[:2])
    for k, turn in enumerate(TURNS):
        uv = np.nan_to_num(view.project(rays @ turn), nan=-1).astype(np.float32).reshape(*out.shape[:2], 2)
        seen = renderer.image(view, world_from_camera @ Pose(turn), 1)
        np.copyto(out, cv2.remap(seen, uv, None, cv2.INTER_LINEAR), where=(ahead == k)[..., None])  # type: ignore[call-overload]
    return np.clip(np.rint(out), 0, 255).astype(np.uint8)
