"""What a headless run tells: trajectories in the asked frame, metrics, and how it was made."""

from __future__ import annotations

import hashlib
import json
import math
import platform
from array import array
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from typing import Any

import numpy as np
import yaml

from ispom.evaluation import metrics
from ispom.methods import Config, with_asked
from ispom.methods import method as registered
from ispom.types import Frame, Rig, Sequence, Status, StereoPair, Trajectory

from .events import Finished, Opened, Stepped

PACKAGES = ("ispom", "numpy", "scipy", "opencv-python-headless", "numba", "open3d", "rerun-sdk")


@dataclass
class RunStatistics:
    """What is counted while a run goes on."""

    ms: dict[str, array[float]] = field(default_factory=dict)
    lost: dict[str, int] = field(default_factory=dict)
    skipped: list[str] = field(default_factory=list)
    """What was wrong with each exposure that was left out."""
    images: Any = field(default_factory=hashlib.sha256)
    """SHA-256 of all that the estimators saw: the time, size and pixels of each image."""

    def add(self, event: Stepped) -> None:
        seen = event.exposure
        for image in (seen.left, seen.right) if isinstance(seen, StereoPair) else (seen.image,):
            self.images.update(f"{seen.time_ns} {image.shape}\n".encode())
            self.images.update(np.ascontiguousarray(image))
        self.skipped += [event.skipped] if event.skipped else []
        for step in event.steps:
            self.ms.setdefault(step.method, array("d")).append(1000 * sum(step.seconds.values()))
            self.lost[step.method] = self.lost.get(step.method, 0) + (step.status == Status.LOST)

    def of(self, method: str) -> dict[str, Any]:
        ms = self.ms.get(method, [])
        median, p95 = np.percentile(ms, [50, 95]).tolist() if ms else (None, None)
        return {"lost": self.lost.get(method, 0), "ms_per_exposure": {"median": median, "p95": p95}}


def in_frame(trajectory: Trajectory, rig: Rig, frame: Frame, unit_m: float | None = 1.0) -> Trajectory:
    """world_from_FRAME of world_from_OTHER, in the trajectory's own unit of `unit_m` metres.

    The lever arm is metric: where the unit is unknown (None) only the orientation is turned, and positions stay those
    of the camera that the trajectory is of.
    """
    own_from_frame = rig.rig_from(trajectory.frame).inverse() @ rig.rig_from(frame)
    return trajectory.moved(right=own_from_frame.scaled(1 / unit_m if unit_m else 0.0), frame=frame)


def metrics_text(opened: Opened, finished: Finished, methods: tuple[str, ...], statistics: RunStatistics) -> str:
    """metrics.json. Without truth: only what can be said without it."""
    sequence, truth = opened.sequence, opened.truth
    report: dict[str, Any] = {"sequence": sequence.name, "notes": list(sequence.notes)}
    report |= {"skipped": statistics.skipped, "methods": {}}
    if truth is not None:
        report["path_length_m"] = truth.select(truth.times_ns <= sequence.times_ns[-1]).length
    for method in methods:
        trajectory = finished.trajectories[method]
        entry = {"poses": len(trajectory), **statistics.of(method)}
        if truth is not None:
            entry |= metrics.errors(trajectory, truth, sequence.rig, metric=registered(method).unit == "metric")
        if truth is not None and (stereo := registered(method).asks.get("stereo")):
            entry |= metrics.between_stereo(trajectory, finished.trajectories[stereo], truth)
        report["methods"][method] = entry
    return json.dumps(_finite(report), indent=2, allow_nan=False) + "\n"


def run_text(
    source: str, sequence: Sequence, options: Mapping[str, Any], config: Config, images_sha256: str | None = None
) -> str:
    """run.yaml: what is needed to repeat the run, and to know that it was on the same images (of a run that ended)."""
    found = {
        "source": source,
        "sequence": sequence.name,
        "notes": list(sequence.notes),
        "exposures": {kind: sequence.kinds.count(kind) for kind in ("video", "stereo")},
        "images_sha256": images_sha256,
        "options": dict(options),
        "config": {name: asdict(config.of(name)) for name in with_asked(options["methods"])},
        "versions": {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}},
        "platform": platform.platform(),
    }
    return yaml.safe_dump(found, sort_keys=False, allow_unicode=True)


def summary(report: Mapping[str, Any]) -> str:
    """The metrics as a few lines for the terminal."""
    lines = [f"left out: {fault}" for fault in report["skipped"]]
    width = max(map(len, report["methods"]), default=0)
    for method, entry in report["methods"].items():
        parts = [f"{entry['poses']} poses", f"lost {entry['lost']}"]
        if entry.get("ate_m") is not None:
            parts.append(f"ATE {entry['ate_m']:.3f} m ({entry['aligned']})")
        if entry.get("t_err_percent") is not None:
            parts.append(f"drift {entry['t_err_percent']:.2f} %")
        if entry.get("between_stereo_rmse_m") is not None:
            between, spline = entry["between_stereo_rmse_m"], entry["spline_between_stereo_rmse_m"]
            parts.append(f"between stereo {1000 * between:.1f} mm (spline {1000 * spline:.1f} mm)")
        if entry.get("step_scale_end_over_start") is not None:
            parts.append(f"step scale at the end {entry['step_scale_end_over_start']:.2f} of that at the start")
        if entry["ms_per_exposure"]["median"] is not None:
            parts.append(f"{entry['ms_per_exposure']['median']:.0f} ms per exposure")
        lines.append(f"{method:<{width}} {', '.join(parts)}")
    return "\n".join(lines)


def _finite(value: Any) -> Any:
    """Null for what JSON has no number for."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
