"""What one run of an experiment gave: its numbers, or why it failed."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ispom.evaluation.scale import step_scale
from ispom.evaluation.trajectory_error import MIN_POSES, alignment, associate
from ispom.io.files import exists
from ispom.io.trajectories import read_tum
from ispom.methods import method as registered
from ispom.types import Trajectory

from ...engine.run_folder.run_file import RunFile, read_run_file
from ...engine.run_folder.run_folder import METRICS, RUN, TRUTH, is_incomplete, trajectory_file
from ..headless.command import NO_MOTION
from .plan import MEASURED, FailureKind, Run


def paths_of(run: Run, folder: Path) -> tuple[Trajectory, Trajectory] | None:
    """The method's poses and the true ones; None without truth."""
    if not exists(folder / TRUTH):
        return None
    return read_tum(folder / trajectory_file(run.line.method)), read_tum(folder / TRUTH)


def compared(run: Run, folder: Path) -> tuple[Trajectory, Trajectory] | None:
    """Those of the same times; None without truth, or with too few."""
    paths = paths_of(run, folder)
    pairs = associate(*paths) if paths is not None else None
    return pairs if pairs is not None and len(pairs[0]) >= MIN_POSES else None


@dataclass(frozen=True)
class Row:
    """Without the values that are `MEASURED`, the same plan gives the same rows, wherever its runs are computed."""

    run: Run
    failure: str | None = None
    """One sentence; None where the run came to its end."""
    values: Mapping[str, float | None] | None = None
    """The numbers of metrics.json, and derived ones; None where it failed."""
    images_sha256: str | None = None
    """Of all images that the run saw."""

    def failed(self, quantity: str) -> FailureKind | None:
        """Returns how the method failed, where it was run and has no such number; None where it has one, or where
        something else was wrong: a missing package or source, or a fault."""
        if self.failure is not None:
            return "no motion" if NO_MOTION in self.failure else None
        return "lost" if (self.values or {}).get(quantity) is None else None


def row_of(run: Run, folder: Path) -> Row | None:
    """Of a run that is complete; None where there is none. InputError where its files are not as written."""
    if not exists(folder / RUN) or is_incomplete(folder):
        return None
    written = read_run_file(folder)
    report = json.loads((folder / METRICS).read_text(encoding="utf-8"))
    values = _values(report, run.line.method, written) | _scales(run, folder)
    return Row(run, None, values, written.images_sha256)


def _values(report: Mapping[str, Any], method: str, written: RunFile) -> dict[str, float | None]:
    entry, length_m = report["methods"][method], report.get("path_length_m")
    plain = {key: entry[key] for key in entry if isinstance(entry[key], int | float | None)}
    per_m = 100 / length_m if length_m else None
    exposures = sum(written.exposures.get(kind, 0) for kind in registered(method).sensors)
    return {
        **plain,
        **_measured(report),
        "path_length_m": length_m,
        "ate_percent": per_m and entry.get("ate_m") and per_m * entry["ate_m"],
        "rate_hz": entry["poses"] / written.duration_s if written.duration_s else None,
        "located_percent": 100 * entry["located"] / exposures if exposures else None,
        "segments": float(len(entry.get("segments", [0]))),
        "between_over_spline": _ratio(entry.get("between_stereo_rmse_m"), entry.get("spline_between_stereo_rmse_m")),
    }


def _measured(report: Mapping[str, Any]) -> dict[str, float | None]:
    """What the run took: None where it was not measured."""
    cpu = report.get("cpu_ms_per_exposure", {})
    return dict(zip(MEASURED, (cpu.get("median"), cpu.get("p95"), report.get("peak_memory_mb")), strict=True))


def _ratio(one: float | None, other: float | None) -> float | None:
    return one / other if one is not None and other else None


def _scales(run: Run, folder: Path) -> dict[str, float | None]:
    """Of every method, metric or not: how its unit changes, and what it is."""
    found = compared(run, folder)
    if found is None:
        return {}
    scale = step_scale(*found)
    return {
        "step_scale_end_over_start": scale and scale.end_over_start,
        "m_per_unit": alignment(*found, "sim3").scale,
    }


def milliseconds(run: Run, folder: Path) -> tuple[float | None, float | None]:
    """Median and 95th percentile of the time per frame, as measured in that run."""
    try:
        found = json.loads((folder / METRICS).read_text(encoding="utf-8"))["methods"][run.line.method][
            "ms_per_exposure"
        ]
    except (OSError, ValueError, KeyError):
        return None, None
    return found["median"], found["p95"]
