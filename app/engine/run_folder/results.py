"""The results of a run: trajectories in the frame of the option, and metrics."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ispom.evaluation import metrics
from ispom.io.trajectories import tum_text
from ispom.methods import method as registered
from ispom.types import FrameName, Rig, Trajectory

from ...presentation.texts import ALIGNED, computing_time, length, length_unit, lengths
from ..outputs import json_text
from .run_folder import segment_file, trajectory_file
from .statistics import RunStatistics


def in_frame(trajectory: Trajectory, rig: Rig, frame: FrameName, unit_m: float | None = 1.0) -> Trajectory:
    """world_from_FRAME of world_from_OTHER, in the trajectory's own unit of `unit_m` metres.

    The lever arm is metric: where the unit is unknown (None) only the orientation is turned, and positions stay those
    of the camera that the trajectory is of.
    """
    own_from_frame = rig.rig_from(trajectory.frame).inverse() @ rig.rig_from(frame)
    return trajectory.moved(right=own_from_frame.scaled(1 / unit_m if unit_m else 0.0), frame=frame)


@dataclass(frozen=True, eq=False)
class Results:
    """The results of a run, up to its last frame."""

    sequence: str
    """Its name."""
    notes: Sequence[str]
    rig: Rig
    truth: Trajectory | None
    """world_from_rig."""
    end_ns: int
    """The last frame's time."""
    trajectories: Mapping[str, Trajectory]
    """By method, each in its own world and frame; including those of the methods that they depend on."""


def metrics_text(results: Results, methods: Iterable[str], statistics: RunStatistics) -> str:
    """Returns metrics.json. Without truth it has only metrics that need none."""
    truth = results.truth
    report: dict[str, Any] = {"sequence": results.sequence, "notes": list(results.notes)}
    report |= {"skipped": statistics.skipped, **statistics.resources(), "methods": {}}
    if truth is not None:
        report["path_length_m"] = truth.select(truth.times_ns <= results.end_ns).length
    for method in methods:
        trajectory = results.trajectories[method]
        entry = {"poses": len(trajectory), **statistics.entry(method)}
        if truth is not None:
            entry |= metrics.path_errors(trajectory, truth, results.rig, metric=registered(method).unit == "metric")
        segments = list(segments_of(trajectory, statistics.segments(method)))
        if len(segments) > 1:
            entry["segments"] = [_segment(s, results, metric=registered(method).unit == "metric") for s in segments]
        stereo = registered(method).asks.get("stereo")
        if truth is not None and stereo is not None and stereo in results.trajectories:
            entry |= metrics.between_stereo(trajectory, results.trajectories[stereo], truth)
        report["methods"][method] = entry
    return json_text(report, 2)


def trajectory_files(
    method: str, trajectory: Trajectory, starts: Sequence[tuple[int, int]]
) -> Iterator[tuple[str, str]]:
    """Yields names and contents of files: one with all poses, and, if there are several segments, one for each."""
    yield trajectory_file(method), tum_text(trajectory)
    segments = list(segments_of(trajectory, starts))
    for number, segment in enumerate(segments if len(segments) > 1 else (), 1):
        yield segment_file(method, number), tum_text(segment)


def segments_of(trajectory: Trajectory, starts: Sequence[tuple[int, int]]) -> Iterator[Trajectory]:
    """Yields the segments that have poses. No observation joins two segments; each has its own world."""
    if not starts:
        return
    begin_ns, worlds = np.array(starts, np.int64).T
    world = worlds[np.maximum(np.searchsorted(begin_ns, trajectory.times_ns, side="right") - 1, 0)]
    for number in np.unique(worlds):
        part = trajectory.select(world == number)
        if len(part):
            yield part


def _segment(part: Trajectory, results: Results, metric: bool) -> dict[str, Any]:
    """Returns the metrics of one segment, which no observation joins to the others."""
    found: dict[str, Any] = {"from_ns": int(part.times_ns[0]), "until_ns": int(part.times_ns[-1]), "poses": len(part)}
    if results.truth is not None:
        found |= metrics.path_errors(part, results.truth, results.rig, metric)
    return found


def summary(report: Mapping[str, Any]) -> str:
    """The metrics as a few lines for the terminal."""
    lines = [f"skipped: {fault}" for fault in report["skipped"]]
    width = max(map(len, report["methods"]), default=0)
    unit = length_unit(entry.get("ate_m") for entry in report["methods"].values())
    for method, entry in report["methods"].items():
        parts = [f"{entry['located']} of {entry['frames']} frames located", f"{entry['poses']} poses"]
        if entry["located"] and entry["lost"]:
            parts.append(f"lost in {entry['lost']}")
        if not entry["located"]:
            why = f" ({entry['never_located'].removesuffix('.')})" if "never_located" in entry else ""
            parts = [f"never located{why}: its {entry['poses']} poses are held ones"]
        if "segments" in entry:
            parts.append(f"{len(entry['segments'])} segments that nothing joins")
        if entry.get("ate_m") is not None:
            parts.append(f"ATE {length(entry['ate_m'], unit)} ({ALIGNED[entry['aligned']]})")
        if entry.get("t_err_percent") is not None:
            parts.append(f"drift {entry['t_err_percent']:.2f} %")
        if entry.get("between_stereo_rmse_m") is not None:
            between, spline = lengths([entry["between_stereo_rmse_m"], entry["spline_between_stereo_rmse_m"]])
            parts.append(f"between stereo {between} (spline {spline})")
        if entry.get("step_scale_end_over_start") is not None:
            parts.append(f"step scale at the end {entry['step_scale_end_over_start']:.2f} of that at the start")
        if entry["ms_per_exposure"]["median"] is not None:
            parts.append(f"median {computing_time(entry['ms_per_exposure']['median'] / 1000)} per frame")
        lines.append(f"{method:<{width}} {', '.join(parts)}")
    return "\n".join(lines)
