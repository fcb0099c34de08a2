"""What the JSON file of `ispom evaluate` holds. Numbers are null where they cannot be computed."""

from __future__ import annotations

from typing import Any

import msgspec

from ispom.evaluation.audit.finding import Finding
from ispom.evaluation.comparison import local_scale
from ispom.io.poses.dialect import TrajectoryFile

from .audit import Audit
from .evaluated import Evaluated, Evaluation, frame_of


class FileRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A file of poses."""

    path: str
    format: str
    poses: int
    frame: str | None
    """Whose poses they are, where that is known."""
    timed: bool


class LocalScale(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Units of the estimate, before alignment, per unit of the reference, in windows along the path."""

    times_ns: list[int]
    scale: list[float]


class Body(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The reference's body in the estimate's."""

    translation: tuple[float, float, float]
    quaternion_xyzw: tuple[float, float, float, float]


class FindingRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A finding of the audit."""

    key: str
    of: str
    """estimate or reference."""
    sentence: str
    option: str
    """What corrects it; empty where nothing does."""
    values: dict[str, float]
    sigmas: dict[str, float]
    before: dict[str, float | None]
    after: dict[str, float | None]
    stretch_s: float | None
    error_ratio: float | None
    """Error after over before, of stretches that had no part in the fit."""
    cannot_tell_from: list[str]
    stretches_s: list[tuple[float, float]]
    """On the clock of the reference."""
    poses: list[tuple[int, int]]
    """The same in the file, from 1."""
    parts_m: list[float]
    """ATE of each part between jumps."""
    body: Body | None


class EstimateRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An estimate, its errors, and its audit."""

    name: str
    path: str
    format: str
    poses: int
    frame: str | None
    timed: bool
    poses_given: int | None
    poses_asked: int | None
    longest_gap_s: float | None
    alignment_scale: float | None
    ate_rmse_m: float | None
    ate_mean_m: float | None
    ate_median_m: float | None
    ate_max_m: float | None
    ate_rmse_deg: float | None
    ate_mean_deg: float | None
    ate_median_deg: float | None
    ate_max_deg: float | None
    rpe_rmse_m: float | None
    rpe_mean_m: float | None
    rpe_median_m: float | None
    rpe_max_m: float | None
    rpe_rmse_deg: float | None
    rpe_mean_deg: float | None
    rpe_median_deg: float | None
    rpe_max_deg: float | None
    kitti_t_percent: float | None
    kitti_r_deg_per_100m: float | None
    kitti_shortest_m: float | None
    kitti_longest_m: float | None
    scale_start: float | None
    scale_end: float | None
    scale_end_over_start: float | None
    rpe_interval_s: float | None
    """Median time of the motions of the relative error."""
    local_scale: LocalScale
    audit: list[FindingRow] | None
    """null where no audit was asked for."""


class EvaluateFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the JSON file of `ispom evaluate` holds."""

    protocol: dict[str, str]
    notes: list[str]
    reference: FileRow
    estimates: list[EstimateRow]


def written(found: Evaluation) -> EvaluateFile:
    """Returns what the file holds."""
    audits = found.audits or [None] * len(found.items)
    rows = [_estimate(item, audit) for item, audit in zip(found.items, audits, strict=True)]
    return EvaluateFile(found.protocol, found.notes, FileRow(**_about(found.reference)), rows)


def _estimate(item: Evaluated, audit: Audit | None) -> EstimateRow:
    values: dict[str, Any] = dict(item.measures)
    return EstimateRow(
        name=item.name,
        **_about(item.file),
        **values,
        rpe_interval_s=item.rpe_interval_s,
        local_scale=LocalScale(**local_scale(item.found)),
        audit=None if audit is None else [_finding(audit, each) for each in audit.findings],
    )


def _about(file: TrajectoryFile) -> dict[str, Any]:
    return {
        "path": str(file.path),
        "format": file.format,
        "poses": len(file.trajectory),
        "frame": frame_of(file),
        "timed": file.timed,
    }


def _finding(audit: Audit, found: Finding) -> FindingRow:
    body = found.own.body
    return FindingRow(
        found.key,
        found.whose,
        audit.sentence(found),
        audit.option(found),
        dict(found.values),
        dict(found.sigmas),
        dict(found.before),
        dict(found.after),
        found.stretch_s,
        found.fall,
        list(found.rivals),
        list(found.spans_s),
        list(found.rows),
        list(found.parts_m),
        None if body is None else Body(_tuple(body.translation), _tuple(body.xyzw)),
    )


def _tuple(values: Any) -> Any:
    return tuple(map(float, values))
