"""The size at which cameras are drawn, relative to the size of the scene, because its unit may be unknown."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ispom.methods import method as registered
from ispom.types import Rig, Trajectory

from .poses import PoseHistory

OF_TRUE_PATH = 0.04
"""Depth of a camera, relative to the extent of the true path."""
OF_SPACING = 0.35
"""Depth of a keyframe, relative to the distance of keyframes or to the depth of a camera, whichever is less."""
OF_BASELINE = 2.0
"""Least depth of a camera, relative to the stereo baseline, where there is no true path."""
NOTICED = 1.5
"""Factor by which the distance of keyframes must change before the size changes. A new size redraws all cameras."""


@dataclass(frozen=True)
class DrawnSize:
    """Sizes of drawn cameras, in the unit of the method's own world."""

    camera: float
    """Depth of the current camera's frustum."""
    key_frame: float
    """Depth of a keyframe's frustum, so small that neighbours do not overlap."""
    spacing: float
    """Distance of successive keyframes from which these sizes were computed; 0 with fewer than two keyframes."""


def drawn_truth(truth: Trajectory | None, methods: Iterable[str]) -> Trajectory | None:
    """Returns the true path if it can be drawn without an alignment: a method is metric and has its world at the start,
    or there are no methods. Otherwise None."""
    known = [registered(method) for method in methods]
    return truth if not known or any(m.unit == "metric" and m.world == "start" for m in known) else None


def unit_in_metres(method: str, placed_scale: float) -> float | None:
    """Returns the unit of a method's own world [m]; None where it is unknown."""
    return placed_scale if registered(method).unit == "metric" or placed_scale != 1.0 else None


def true_size(truth: Trajectory | None) -> float | None:
    """Returns the depth of the true camera [m]; None without a true path, or where it does not move."""
    if truth is None or not len(truth):
        return None
    return OF_TRUE_PATH * float(np.linalg.norm(np.ptp(truth.translations, axis=0))) or None


def drawn_size(
    method: str, rig: Rig, truth: Trajectory | None, poses: PoseHistory, unit_m: float, before: DrawnSize | None
) -> DrawnSize:
    """Returns the sizes for a method whose unit is `unit_m` metres (1 where unknown). This is the object `before` where
    the distance of keyframes is still about the same."""
    spacing = _spacing(poses)
    if before is not None and (not spacing or 1 / NOTICED < before.spacing / spacing < NOTICED):
        return before
    is_known = unit_in_metres(method, unit_m) is not None or not spacing
    true, least = true_size(truth), OF_BASELINE * rig.baseline_m if rig.has_stereo else 0.0
    camera = true / unit_m if true is not None and is_known else max(spacing, least / unit_m) or 1.0
    return DrawnSize(camera, OF_SPACING * min(camera, spacing or camera), spacing)


def _spacing(poses: PoseHistory) -> float:
    """Returns the median distance of successive keyframes in the first block that has two; 0 without one."""
    for b in range(len(poses.blocks)):
        if len(rows := poses.key_frame_rows(b)) > 1:
            places = np.stack([poses.position(int(row)) for row in rows])
            return float(np.median(np.linalg.norm(np.diff(places, axis=0), axis=1)))
    return 0.0
