"""How large cameras are drawn: by the scene's own scale, whatever its unit is."""

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
"""Depth of a keyframe, relative to their distance or to a camera, whichever is less."""
OF_BASELINE = 2.0
"""The same relative to the stereo baseline: the least, where there is no true path."""
NOTICED = 1.5
"""The size follows the keyframes' distance when that has changed by such a factor: a change draws all again."""


@dataclass(frozen=True)
class DrawnSize:
    """In the unit of the method's own world."""

    camera: float
    """Depth of the current camera's frustum."""
    key_frame: float
    """The same of a keyframe: neighbours do not overlap."""
    spacing: float
    """Distance of successive keyframes that they were made from; 0 where there are not two."""


def drawn_truth(truth: Trajectory | None, methods: Iterable[str]) -> Trajectory | None:
    """The true path where it can be drawn as it is: with metric estimates whose world is at the start, or with none."""
    known = [registered(method) for method in methods]
    return truth if not known or any(m.unit == "metric" and m.world == "start" for m in known) else None


def unit_in_metres(method: str, placed_scale: float) -> float | None:
    """Of a method's own world; None where it is not known."""
    return placed_scale if registered(method).unit == "metric" or placed_scale != 1.0 else None


def true_size(truth: Trajectory | None) -> float | None:
    """Depth of the true camera [m]; None without a true path, or where it goes nowhere."""
    if truth is None or not len(truth):
        return None
    return OF_TRUE_PATH * float(np.linalg.norm(np.ptp(truth.translations, axis=0))) or None


def drawn_size(
    method: str, rig: Rig, truth: Trajectory | None, poses: PoseHistory, unit_m: float, before: DrawnSize | None
) -> DrawnSize:
    """Of a method whose unit is `unit_m` metres (1 where nobody knows); the same object as `before` where the key
    frames are about as far apart as then."""
    spacing = _spacing(poses)
    if before is not None and (not spacing or 1 / NOTICED < before.spacing / spacing < NOTICED):
        return before
    is_known = unit_in_metres(method, unit_m) is not None or not spacing
    true, least = true_size(truth), OF_BASELINE * rig.baseline_m if rig.has_stereo else 0.0
    camera = true / unit_m if true is not None and is_known else max(spacing, least / unit_m) or 1.0
    return DrawnSize(camera, OF_SPACING * min(camera, spacing or camera), spacing)


def _spacing(poses: PoseHistory) -> float:
    """Median distance of the first keyframes in a row; 0 where there are not two."""
    for b in range(len(poses.blocks)):
        if len(rows := poses.key_frame_rows(b)) > 1:
            places = np.stack([poses.position(int(row)) for row in rows])
            return float(np.median(np.linalg.norm(np.diff(places, axis=0), axis=1)))
    return 0.0
