"""The epipolar line of a point of one view in another: where the poses allow it to be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.estimators.modern.lens import Lens
from ispom.geometry import Array, Pose, skew

from .point import ideal

DEPTHS = 64
"""Points of the line that is drawn."""
NO_BASELINE = 1e-9
"""Relative to the distance from the origin: such motions are a rotation alone, where every point is its own line."""


@dataclass(frozen=True, eq=False)
class EpipolarLine:
    distance_px: float
    """Of the point seen in the second view from the line, in ideal pixels; NaN where the camera only turned."""
    curve_uv: Array
    """(K, 2) [px] where points on the ray are seen, from the nearest to infinity; distortion bends it."""


def epipolar(
    lens: Lens, world_from_first: Pose, world_from_second: Pose, uv_first: Array, uv_second: Array
) -> EpipolarLine:
    """Of pixel uv_first (2,), in the second view, where uv_second (2,) is seen (Hartley and Zisserman 9.1)."""
    second_from_first = world_from_second.inverse() @ world_from_first
    essential = skew(second_from_first.translation) @ second_from_first.rotation
    ray = np.append(lens.normalise(uv_first[None])[0], 1.0)
    k_inverse = np.linalg.inv(lens.camera.matrix)
    line = k_inverse.T @ essential @ ray
    normal = float(np.linalg.norm(line[:2]))
    scale = max(float(np.linalg.norm(world_from_first.translation)), 1.0)
    still = float(np.linalg.norm(second_from_first.translation)) < NO_BASELINE * scale or normal == 0
    distance = np.nan if still else abs(float(line @ np.append(ideal(lens, uv_second[None])[0], 1.0))) / normal
    return EpipolarLine(distance, _curve(lens, second_from_first, ray))


def _curve(lens: Lens, second_from_first: Pose, ray: Array) -> Array:
    """Where the ray (3,) is seen, at depths from a tenth of the baseline to infinity."""
    near = 0.1 * float(np.linalg.norm(second_from_first.translation)) or 1.0
    inverse_depth = np.linspace(1.0, 0.0, DEPTHS)[:, None] ** 3 / near  # denser far away, where most points are
    homogeneous = ray @ second_from_first.rotation.T + inverse_depth * second_from_first.translation
    homogeneous = homogeneous[homogeneous[:, 2] > 1e-3]
    camera = lens.camera
    flat = homogeneous[:, :2] / homogeneous[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    size = np.array([camera.width, camera.height])
    near_image = ((flat > -0.2 * size) & (flat < 1.2 * size)).all(1)  # beyond, the distortion's model folds back
    return lens.project(homogeneous[near_image])
