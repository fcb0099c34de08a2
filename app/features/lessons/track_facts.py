"""What a condition can ask of a track that somebody points at."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ispom.types import Rig, Tracks, TrackStatus

from ...engine.conditions.evaluate import holds
from ...engine.conditions.parser import Expression
from ...engine.history.quantities import NO_ROW, finite
from ...engine.history.quantity import Quantity

TRACK: Mapping[str, Quantity] = {
    q.name: q
    for q in (
        Quantity("track", "disparity_px", "number", "left minus right column", "px"),
        Quantity("track", "depth_m", "number", "by its disparity", "m"),
        Quantity("track", "residual_px", "number", "reprojection error", "px"),
        Quantity("track", "moved_px", "number", "from the same camera's image before", "px"),
        Quantity("track", "dropped", "flag", "whether it ended here"),
        Quantity("track", "disagrees", "flag", "whether it ended because it does not fit the motion"),
    )
}
DISAGREES = (TrackStatus.EPIPOLAR, TrackStatus.REPROJECTION, TrackStatus.RIGID)


def right_tracks(tracks: Tracks, rig: Rig, condition: Expression) -> NDArray[np.bool_]:
    """(N,) for which of the tracks the condition holds."""
    columns = _columns(tracks, rig)
    rows = ({"track": {key: _value(column[i]) for key, column in columns.items()}} for i in range(len(tracks)))
    return np.array([holds(condition, row, NO_ROW) for row in rows], bool)


def _columns(tracks: Tracks, rig: Rig) -> dict[str, NDArray]:
    disparity_px = np.asarray(tracks.disparity_px, float)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth_m = rig.camera("left").fx * rig.baseline_m / disparity_px if rig.has_stereo else disparity_px * np.nan
    return {
        "disparity_px": disparity_px,
        "depth_m": depth_m,
        "residual_px": np.asarray(tracks.residual_px, float),
        "moved_px": np.linalg.norm(tracks.uv - tracks.uv_prev, axis=1),
        "dropped": tracks.status >= TrackStatus.LOST,
        "disagrees": np.isin(tracks.status, DISAGREES),
    }


def _value(cell: object) -> float | bool | None:
    return bool(cell) if isinstance(cell, np.bool_) else finite(float(cell))  # type: ignore[arg-type]
