"""One method on one case, in a process of its own: its peak memory and threads are nobody else's.

`python -m ispom_app.features.benchmark.measure '{...}'` prints what was found as one line of JSON.
"""

from __future__ import annotations

import json
import sys
from collections import defaultdict
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ispom.child import end_with_parent
from ispom.ensemble import Ensemble, build
from ispom.errors import InputError
from ispom.evaluation import metrics
from ispom.evaluation.trajectory_error import MIN_POSES, aligned, associate
from ispom.methods import Config
from ispom.methods import method as registered
from ispom.types import Rig, Sequence, Status, Trajectory

from .plan import CASES, Case
from .unit import Unit, cpu_clock


@dataclass
class Times:
    """Milliseconds of one run."""

    total: list[float] = field(default_factory=list)
    """CPU time of each step."""
    stages: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    """Wall time, as the steps report it."""


def measured(case: Case, method: str, runs: int, pair: tuple[Path, ...]) -> dict[str, Any]:
    """Times (medians of the runs), memory and accuracy. InputError where the case cannot be opened or run."""
    cv2.setNumThreads(1)
    sequence, unit = case.open(), Unit(pair)
    ensemble = ensemble_of(method, sequence.rig)
    used_frames = _used_frames(sequence, method)
    found, trajectory, lost = [], Trajectory.empty(), 0
    for _ in range(runs):
        unit.measure()
        times, trajectory, lost = _run(ensemble, method, sequence, used_frames)
        found.append(times)
    unit.measure()
    peak = peak_mb()
    accuracy = _accuracy(trajectory, sequence, method)
    if sequence.truth is not None and (pairs := registered(method).asks.get("stereo")):
        _, stereo, _ = _run(ensemble_of(pairs, sequence.rig), pairs, sequence, _used_frames(sequence, pairs))
        accuracy |= metrics.between_stereo(trajectory, stereo, sequence.truth)
    return {
        "unit_ms": unit.ms,
        "unit_pair": unit.pair_name,
        "ms": _statistics([times.total for times in found]),
        "stages_ms": {stage: _statistics([t.stages[stage] for t in found]) for stage in found[0].stages},
        "peak_mb": peak,
        **accuracy,
        "poses": len(trajectory),
        "asked": sequence.kinds[: used_frames[-1] + 1].count(
            "video" if "video" in registered(method).sensors else "stereo"
        ),
        "lost": lost,
    }


def ensemble_of(method: str, rig: Rig) -> Ensemble:
    """One method with its default settings."""
    return build(Config(), (method,), rig)


def _used_frames(sequence: Sequence, method: str) -> list[int]:
    """The frames that it uses; no others are decoded."""
    return [i for i, kind in enumerate(sequence.kinds) if kind in registered(method).sensors]


def _run(ensemble: Ensemble, method: str, sequence: Sequence, used_frames: list[int]) -> tuple[Times, Trajectory, int]:
    """One run, and how many steps were lost; each frame is decoded just before its step, outside the clock."""
    state, times, lost = ensemble.start(), Times(), 0
    for i in used_frames:
        exposure = sequence[i]
        start = cpu_clock()
        state, steps = ensemble.step(state, exposure)
        times.total.append(1e3 * (cpu_clock() - start))
        for step in steps:
            lost += step.status == Status.LOST
            for stage, seconds in step.seconds.items():
                times.stages[stage].append(1e3 * seconds)
    return times, ensemble.finish(state)[method], lost


def _statistics(runs: list[list[float]]) -> dict[str, float]:
    """Median and p95 of each run, and the median of these over the runs."""
    median, p95 = np.median([np.percentile(run, [50, 95]) for run in runs if run], axis=0).tolist()
    return {"median": median, "p95": p95}


def _accuracy(trajectory: Trajectory, sequence: Sequence, method: str) -> dict[str, Any]:
    """As in metrics.json; of metric methods also how far off the path came, its first pose being given."""
    if sequence.truth is None:
        return {}
    metric = registered(method).unit == "metric"
    found = metrics.path_errors(trajectory, sequence.truth, sequence.rig, metric)
    truth = sequence.truth.moved(right=sequence.rig.rig_from(trajectory.frame), frame=trajectory.frame)
    own, other = associate(trajectory, truth)
    if metric and len(own) >= MIN_POSES:
        off = aligned(own, other, "first").translations - other.translations
        found["largest_drift_m"] = float(np.linalg.norm(off, axis=1).max())
    return found


def peak_mb() -> float:
    """Returns the peak resident memory of this process [MB = 2**20 bytes]; NaN where the system has no figure.

    Linux counts in ru_maxrss what the parent held when it started this process, therefore VmHWM there.
    """
    if sys.platform.startswith("linux"):
        status = Path("/proc/self/status").read_text(encoding="utf-8")
        line = next((found for found in status.splitlines() if found.startswith("VmHWM:")), None)
        return int(line.split()[1]) / 1024 if line else float("nan")
    if sys.platform == "win32":
        import psutil

        return psutil.Process().memory_info().peak_wset / 2**20  # type: ignore[attr-defined]
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # bytes on macOS


def render(case: Case) -> None:
    """Has the case's images rendered and kept, so that no measurement renders."""
    sequence = case.open()
    if sequence.prepare:
        sequence.prepare(0)
    for i in range(len(sequence)):
        sequence[i]


def answer(task: dict[str, Any]) -> dict[str, Any]:
    """What `command` asks for: a measurement, or with no method the rendering that must come before."""
    case = replace(next(c for c in CASES if c.key == task["case"]), source=task["source"])
    pair = tuple(Path(p) for p in task["pair"])
    try:
        if task["method"] is not None:
            return measured(case, task["method"], task["runs"], pair)
        render(case)
        return {}
    except InputError as error:
        return {"error": str(error)}


if __name__ == "__main__":
    end_with_parent()
    sys.stdout.write(json.dumps(answer(json.loads(sys.argv[1]))) + "\n")
