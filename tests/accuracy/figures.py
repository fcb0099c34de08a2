"""`python -m tests.accuracy figures`: what every method reaches on every recording, kept in `figures.json`.

The file is a ratchet: `test_figures.py` measures again and fails where a figure is worse than its band allows. Change
it only by this command, and review the difference as part of the commit.
`python -m tests.accuracy.figures '{...}'` prints the figures of one method on one recording as one line of JSON.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import cv2
from ispom_app.engine.run_folder.results import Results, metrics_text
from ispom_app.engine.run_folder.statistics import RunStatistics
from rich.console import Console

from ispom.child import end_with_parent
from ispom.ensemble import build
from ispom.io.trajectories import read_tum
from ispom.methods import BUILT_IN, Config, possible_methods
from ispom.methods import method as registered
from ispom.sequences import open_sequence, recognised, recordings_in
from ispom.types import Rig, Sequence, Trajectory

FILE = Path(__file__).with_name("figures.json")
SIMULATIONS = ("sim:tiny", "sim:city", "sim:indoor")
"""With their default seeds."""
REFERENCES = ("truth.tum", "reference.tum")
"""Poses beside the images of a clip, by another program, in a unit of their own."""
NO_RECORDINGS = frozenset({"calibration", "reports", "trajectories"})
"""Folders of the data for other tests: images of targets, samples of file formats, trajectories without images."""
TWO_RATE = "kitti/sequences/06, video at half size, every 5th pair"
"""The emulation of the rig that `integrated` is made for."""
INTEGRATED = ("integrated", "integrated.paper")


@dataclass(frozen=True)
class Figures:
    """What one method reaches on one recording."""

    frames: int
    """Frames that the method uses."""
    located: int
    """Frames that were localised when they came; the poses of the others are held, or were computed later."""
    segments: int
    """Parts of the trajectory that no observation joins; 0 if no frame was localised."""
    seconds: float
    """CPU time of the run, decoding included. It decides which tests are slow, and is not compared."""
    alignment: str | None = None
    """sim3 or se3: as `ispom.evaluation.metrics` aligns; None without reference, as all that follows."""
    path: float | None = None
    """Length of the reference over the recording, in the reference's unit (metres where there is ground truth)."""
    ate: float | None = None
    """Absolute trajectory error of all poses, held ones too, in the same unit; None if there is nothing to compare."""
    ate_percent: float | None = None
    """The same in percent of the path."""
    segment_ate: float | None = None
    """Root mean square over the poses of the errors of segments that are aligned one by one; None for one segment."""

    @property
    def share_located(self) -> float:
        return self.located / self.frames

    @property
    def error(self) -> float | None:
        """The error that is compared. Where nothing joins the segments, their relative placement is a guess, so that
        each counts by itself."""
        return self.ate if self.segment_ate is None else self.segment_ate


Recorded = dict[str, dict[str, Figures]]
"""By recording, by method."""


def recordings(data: Path) -> dict[str, str]:
    """Returns the source that opens each recording, by its name: simulations, and all that is below the data folder."""
    sources = {name: name for name in SIMULATIONS}
    if not data.is_dir():
        return sources
    groups = [p for p in sorted(data.iterdir()) if p.is_dir() and p.name not in NO_RECORDINGS and not recognised(p)]
    for folder in (data, *groups):
        for path in recordings_in(folder):
            if path.relative_to(data).parts[0] not in NO_RECORDINGS:
                sources[path.relative_to(data).as_posix()] = str(path)
    drive = sources.get("kitti/sequences/06")
    return sources if drive is None else sources | {TWO_RATE: drive}


def opened(name: str, source: str) -> Sequence:
    """Opens a recording, with the reference that lies beside its images if it has no ground truth."""
    if name == TWO_RATE:
        return open_sequence(source, stereo_every=5, video_scale=0.5)
    sequence = open_sequence(source)
    reference = next((p for file in REFERENCES if (p := Path(source) / file).is_file()), None)
    if sequence.truth is None and reference is not None:
        return replace(sequence, truth=read_tum(reference))
    return sequence


def methods_for(name: str, sequence: Sequence) -> list[str]:
    """Returns the built-in methods that are measured on a recording."""
    possible = [name for name in BUILT_IN if name in possible_methods(sequence.rig)]
    return [m for m in possible if name != TWO_RATE or m in INTEGRATED]


@dataclass(frozen=True, eq=False)
class Run:
    """What one method did on one recording."""

    frames: int
    """Frames that the method uses."""
    seconds: float
    """CPU time, decoding included."""
    statistics: RunStatistics
    """Its milliseconds are CPU time, too."""
    truth: Trajectory | None
    """world_from_rig while there are images; None without reference."""
    rig: Rig
    trajectory: Trajectory
    path: float | None
    """Length of the reference, in its unit."""
    report: Mapping[str, Any]
    """The method's entry of metrics.json."""

    @property
    def located(self) -> int:
        """Frames that were localised when they came."""
        return self.report["located"]


def run(name: str, source: str, method: str) -> Run:
    """Runs one method with its default settings over a whole recording."""
    sequence = opened(name, source)
    used = [i for i, kind in enumerate(sequence.kinds) if kind in registered(method).sensors]
    if sequence.prepare is not None:  # rendering is not part of the time
        for i in used:
            sequence[i]
    started = before = time.process_time()
    ensemble, statistics = build(Config(), (method,), sequence.rig), RunStatistics()
    state = ensemble.start()
    for i in used:
        state, steps = ensemble.step(state, sequence[i])
        now = time.process_time()
        for step in steps:
            statistics.add_step(step, 1e3 * (now - before))
        before = now
    trajectories = ensemble.finish(state)
    seconds = time.process_time() - started
    truth, (first_ns, last_ns) = sequence.truth, sequence.times_ns[[0, -1]]
    if truth is not None:  # some references begin before the images do
        truth = truth.select((truth.times_ns >= first_ns) & (truth.times_ns <= last_ns))
    results = Results(name, sequence.notes, sequence.rig, truth, int(last_ns), trajectories)
    report = json.loads(metrics_text(results, [method], statistics))
    return Run(
        len(used),
        seconds,
        statistics,
        truth,
        sequence.rig,
        trajectories[method],
        report.get("path_length_m"),
        report["methods"][method],
    )


def measure(name: str, source: str, method: str) -> Figures:
    """Runs one method over a recording, and returns its figures."""
    return figures_of(run(name, source, method))


def figures_of(done: Run) -> Figures:
    """Returns the figures of a run."""
    found, path = done.report, done.path
    parts = found.get("segments", [])
    count = len(parts) if parts else int(done.located > 0)
    figures = Figures(done.frames, done.located, count, rounded(done.seconds, 2))
    if path is None:
        return figures
    ate = found["ate_m"] if count else None  # held poses alone are no estimate
    return replace(
        figures,
        alignment=found["aligned"],
        path=rounded(path),
        ate=None if ate is None else rounded(ate),
        ate_percent=None if ate is None else rounded(100 * ate / path),
        segment_ate=_over_segments(parts),
    )


def _over_segments(parts: list[dict[str, Any]]) -> float | None:
    """Root mean square error of segments, each weighted by its poses; those with too few poses do not count."""
    measured = [part for part in parts if part["ate_m"] is not None]
    poses = sum(part["poses"] for part in measured)
    return rounded(math.sqrt(sum(p["poses"] * p["ate_m"] ** 2 for p in measured) / poses)) if poses else None


def rounded(value: float, digits: int = 4) -> float:
    """Returns the value rounded to `digits` significant digits."""
    return float(f"{value:.{digits}g}")


def read_figures(file: Path = FILE) -> Recorded:
    """Reads the recorded figures."""
    entries = json.loads(file.read_text(encoding="utf-8"))
    return {name: {method: Figures(**entry) for method, entry in by.items()} for name, by in entries.items()}


def write_figures(table: Recorded, file: Path = FILE) -> None:
    """Writes one line for each method, sorted, so that a difference can be reviewed."""
    blocks = []
    for name in sorted(table):
        lines = [f"    {json.dumps(m)}: {json.dumps(_entry(table[name][m]))}" for m in sorted(table[name])]
        blocks.append(f"  {json.dumps(name)}: {{\n" + ",\n".join(lines) + "\n  }")
    file.write_text("{\n" + ",\n".join(blocks) + "\n}\n", encoding="utf-8")


def _entry(figures: Figures) -> dict[str, Any]:
    """Without the fields that say nothing."""
    return {key: value for key, value in asdict(figures).items() if value is not None}


def print_figures(console: Console, name: str, method: str, figures: Figures) -> None:
    """Prints one entry as a line."""
    f, error = figures, "no reference"
    if f.alignment is not None:
        error = "no ATE" if f.ate is None else f"ATE {f.ate:g} ({f.alignment}), {f.ate_percent:g} % of the path"
    each = "" if f.segment_ate is None else f", per segment {f.segment_ate:g}"
    console.print(
        f"{name}, {method}: {f.located} of {f.frames} frames located, segments: {f.segments}, {error}{each}, "
        f"{f.seconds:g} CPU-s"
    )


def main(argument: str) -> None:
    task = json.loads(argument)
    cv2.setNumThreads(1)
    sys.stdout.write(json.dumps(asdict(measure(task["name"], task["source"], task["method"]))) + "\n")


if __name__ == "__main__":
    end_with_parent()
    main(sys.argv[1])
