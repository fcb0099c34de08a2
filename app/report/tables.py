"""The report's tables: what was run, what came out, counts, times and decisions. Units stand in the heads."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from ispom.types import TrackStatus

from ..run.step_log import DROPPED
from .analysis import changes, mattered
from .folder import Run
from .markup import details, paragraph, table

MOST_DECISIONS = 60
"""Of a run, in full."""
SCORES = {
    "poses": "poses",
    "lost": "exposures lost",
    "aligned": "aligned by",
    "ate_m": "ATE (RMS) [m]",
    "rpe_m": "RPE, pose to pose [m]",
    "rpe_deg": "RPE, pose to pose [deg]",
    "t_err_percent": "KITTI drift [%]",
    "r_err_deg_per_100m": "KITTI drift [deg / 100 m]",
    "between_stereo_rmse_m": "between stereo, RMS [m]",
    "spline_between_stereo_rmse_m": "a spline there, RMS [m]",
    "step_scale_end_over_start": "step scale, end / start [1]",
}


def results(runs: list[Run]) -> str:
    """A column per run and method, the runs side by side."""
    columns = [(run, method) for run in runs for method in run.metrics]
    rows: list[list[Any]] = []
    if len(runs) > 1:
        rows.append(["run", *(run.label for run, _ in columns)])
    for name, title in SCORES.items():
        if any(name in run.metrics[method] for run, method in columns):
            rows.append([title, *(run.metrics[method].get(name) for run, method in columns)])
    for part, title in (("median", "time per exposure, median [ms]"), ("p95", "time per exposure, 95 % [ms]")):
        rows.append([title, *(_milliseconds(run.metrics[method], part) for run, method in columns)])
    return table(["", *(method for _, method in columns)], rows)


def _milliseconds(entry: Mapping[str, Any], part: str) -> Any:
    found = entry.get("ms_per_exposure")
    return found.get(part) if isinstance(found, dict) else None


def provenance(runs: list[Run]) -> str:
    """Source, options, versions, settings and hashes, a column per run."""
    head = ["", *(run.label for run in runs)]
    rows: list[list[Any]] = [
        ["folder", *(str(run.path) for run in runs)],
        ["source", *(run.told["source"] for run in runs)],
        ["sequence", *(run.told["sequence"] for run in runs)],
        ["notes", *(run.told["notes"] for run in runs)],
        ["true path length [m]", *(run.path_length_m for run in runs)],
        ["exposures", *(_pairs(run.told.get("exposures")) for run in runs)],
        ["platform", *(run.told.get("platform") for run in runs)],
        ["SHA-256 of the images and their times", *(_sha256(run) for run in runs)],
        ["SHA-256 of the settings", *(_settings_sha256(run)[:16] for run in runs)],
    ]
    options = _flat_rows([run.told["options"] for run in runs])
    versions = _flat_rows([run.told["versions"] for run in runs])
    settings = _flat_rows([_flat(run.told["config"]) for run in runs])
    differing = [row for row in [*options, *settings, *versions] if len({str(value) for value in row[1:]}) > 1]
    told = table(head, rows, numeric=False)
    if len(runs) > 1:
        told += paragraph("What differs between the runs" if differing else "Settings and versions are the same.")
        told += table(head, differing, numeric=False) if differing else ""
    told += details("Options and versions", table(head, [*options, *versions], numeric=False))
    told += details("Every setting of the methods", table(head, settings, numeric=False))
    files = sorted({name for run in runs for name in run.sha256})
    hashes = [[name, *(run.sha256.get(name) for run in runs)] for name in files]
    return told + details("SHA-256 of the files", table(head, hashes, numeric=False))


def _pairs(value: Any) -> str | None:
    return ", ".join(f"{count} {kind}" for kind, count in value.items()) if isinstance(value, dict) else None


def _flat(config: Mapping[str, Any]) -> dict[str, Any]:
    """method.setting: value; of a variant variant.method.setting."""
    found: dict[str, Any] = {}
    for name, value in config.items():
        found |= {f"{name}.{k}": v for k, v in _flat(value).items()} if isinstance(value, dict) else {str(name): value}
    return found


def _flat_rows(columns: list[dict[str, Any]]) -> list[list[Any]]:
    names = dict.fromkeys(name for column in columns for name in column)
    return [[name, *(column.get(name) for column in columns)] for name in names]


def _sha256(run: Run) -> str | None:
    """Equal for runs over the same images; None of a run that did not tell."""
    told = run.told.get("images_sha256")
    return told[:16] if isinstance(told, str) else None


def _settings_sha256(run: Run) -> str:
    """Equal for runs with the same options and settings."""
    told = json.dumps([run.told["options"], run.told["config"]], sort_keys=True, default=str)
    return hashlib.sha256(told.encode()).hexdigest()


def counts(run: Run) -> str:
    """Key frames, states, tracks, inliers: a column per method."""
    columns = list(run.steps.items())
    rows: list[list[Any]] = [
        ["exposures", *(len(s.status) for _, s in columns)],
        *([f"of these {state}", *(s.status.count(state) for _, s in columns)] for state in ("initialising", "lost")),
        ["key frames (integrated: segments closed)", *(int(s.key_frame.sum()) for _, s in columns)],
        ["time between them, median [s]", *(_between_s(s.times_ns[s.key_frame]) for _, s in columns)],
        ["inliers, median", *(_median(s.columns["inliers"]) for _, s in columns)],
        ["residual, median of medians [px]", *(_median(s.columns["residual_median_px"]) for _, s in columns)],
        ["tracks alive, median", *(_median(s.columns["alive"]) for _, s in columns)],
        ["tracks begun", *(_total(s.columns["new"]) for _, s in columns)],
        ["tracks ended", *(_total(s.dropped) for _, s in columns)],
    ]
    for name, status in DROPPED.items():
        if any(np.nansum(s.columns[name]) for _, s in columns):
            rows.append([f"– {TrackStatus(status).reason}", *(_total(s.columns[name]) for _, s in columns)])
    return table([run.label, *(method for method, _ in columns)], rows)


def _median(values: np.ndarray) -> float | None:
    return float(np.nanmedian(values)) if np.isfinite(values).any() else None


def _total(values: np.ndarray) -> int | None:
    return int(np.nansum(values)) if np.isfinite(values).any() else None


def _between_s(times_ns: np.ndarray) -> float | None:
    return float(np.median(np.diff(times_ns))) * 1e-9 if len(times_ns) > 1 else None


def stages(run: Run) -> str:
    """Time per stage."""
    rows = []
    for method, steps in run.steps.items():
        total = sum(float(values.sum()) for values in steps.stages.values())
        for stage, values in steps.stages.items():
            ms = 1e3 * values[values > 0]
            if len(ms):
                share = 100 * float(values.sum()) / (total or 1.0)
                told = [float(np.median(ms)), float(np.percentile(ms, 95)), float(ms.max())]
                rows.append([stage, method, len(ms), *told, share])
    head = [run.label, "of", "times run", "median [ms]", "95 % [ms]", "longest [ms]", "share of its method [%]"]
    return table(head, rows)


def decisions(run: Run) -> str:
    """Changes of state and failed tests in full; every test as counts."""
    told = sorted(_events(run), key=lambda event: event[0])
    head = ["exposure", "time [s]", "method", "what", "and then"]
    shown = [[exposure, time_s, *what] for exposure, time_s, *what in told[:MOST_DECISIONS]]
    left = paragraph(f"The first {MOST_DECISIONS} of {len(told)}.", "quiet") if len(told) > len(shown) else ""
    return (
        (table(head, shown, numeric=False) if shown else paragraph("Nothing failed, and no method was lost."))
        + left
        + details(f"Every test of {run.label}, counted", _tests(run))
    )


def _events(run: Run) -> list[list[Any]]:
    found = []
    for method, steps in run.steps.items():
        for row, before, after in changes(steps):
            if before:
                time_s = float(run.seconds(steps.times_ns[row]))
                found.append([int(steps.exposures[row]), time_s, method, f"{before} → {after}", ""])
    for said in mattered(run):
        what = str(said.decision).removesuffix(f" ({said.decision.because})")
        time_s = (said.time_ns - run.first_ns) * 1e-9
        found.append([said.exposure, time_s, said.method, what, said.decision.because])
    return found


def _tests(run: Run) -> str:
    grouped: dict[tuple[str, str], list[Any]] = {}
    for said in run.decisions:
        grouped.setdefault((said.method, said.decision.name), []).append(said.decision)
    rows = []
    for (method, name), found in grouped.items():
        values = [d.value for d in found]
        asked = f"{found[-1].relation} {found[-1].threshold:.4g} {found[-1].unit}".strip()
        failed = sum(not d.passed for d in found)
        rows.append([method, name, asked, len(found), failed, float(np.median(values)), min(values), max(values)])
    return table(["method", "test", "asked", "times", "failed", "median", "smallest", "largest"], rows)
