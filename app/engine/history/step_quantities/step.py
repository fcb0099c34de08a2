"""What every Step reports: status, errors, uncertainty, inliers, tracks and times."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ispom.types import Status, Step, TrackStatus

from ...frame_record import INLIERS, LIVE_ERROR, RESIDUAL
from ..quantity import StepQuantity, Value

DROPPED = {f"dropped_{status.name.lower()}": status for status in TrackStatus if status.dropped}
"""By key: why a track ended."""


def _count(status: TrackStatus) -> Callable[[Step, float | None], Value]:
    def count(step: Step, error_m: float | None) -> Value:
        return sum(int((t.status == status).sum()) for t in step.tracks.values()) if step.tracks else None

    return count


def _sigma(step: Step, rows: slice) -> float | None:
    """Returns the square root of the largest eigenvalue of a diagonal block of the covariance."""
    if step.world_from_frame is None or step.covariance is None or not np.isfinite(step.covariance).all():
        return None
    return math.sqrt(max(float(np.linalg.eigvalsh(step.covariance[rows, rows]).max()), 0.0))


def _sigma_deg(step: Step, error_m: float | None) -> Value:
    sigma = _sigma(step, slice(3, 6))
    return None if sigma is None else math.degrees(sigma)


QUANTITIES = (
    StepQuantity("status", lambda s, _: str(s.status), "initialising, tracking, lost", "text", choices=tuple(Status)),
    StepQuantity("key_frame", lambda s, _: bool(s.key_frame), "whether it became a keyframe", "flag"),
    StepQuantity("restarted", lambda s, _: bool(s.restarted), "whether a new world begins here", "flag"),
    StepQuantity(
        "segment_age_ns",
        lambda s, _: s.segment_age_ns or None,
        "how long before this frame the world that begins here had its first one",
        unit="ns",
    ),
    StepQuantity("joins", lambda s, _: s.joins, "the earlier segment, from 0, whose world this one has"),
    StepQuantity("provisional", lambda s, _: bool(s.provisional), "whether its pose is not metric yet", "flag"),
    StepQuantity("error_m", lambda _, error: error, LIVE_ERROR.text, unit=LIVE_ERROR.unit),
    StepQuantity("scale", lambda s, _: s.scale, "factor that carried the unit into this step"),
    StepQuantity("scale_sigma", lambda s, _: s.scale_sigma, "standard deviation of the logarithm of the unit"),
    StepQuantity("sigma_position", lambda s, _: _sigma(s, slice(0, 3)), "1 sigma of the position along its worst axis"),
    StepQuantity("sigma_deg", _sigma_deg, "1 sigma of the orientation about its worst axis", unit="deg"),
    StepQuantity("inliers", lambda s, _: len(s.residuals_px) or None, INLIERS.text),
    StepQuantity(
        "residual_median_px",
        lambda s, _: float(np.median(s.residuals_px)) if len(s.residuals_px) else None,
        RESIDUAL.text,
        unit=RESIDUAL.unit,
    ),
    StepQuantity("landmarks", lambda s, _: len(s.landmarks), "points of the scene found or revised"),
    StepQuantity("revised", lambda s, _: len(s.revised), "earlier poses that were made better"),
    StepQuantity("alive", _count(TrackStatus.ALIVE), "tracks that went on"),
    StepQuantity("new", _count(TrackStatus.NEW), "tracks that began"),
    *(StepQuantity(key, _count(status), f"tracks that ended: {status.reason}") for key, status in DROPPED.items()),
    StepQuantity("seconds", lambda s, _: sum(s.seconds.values()), "wall time; differs from run to run", unit="s"),
)
"""In the order of the columns of steps.csv."""
