"""`python -m tests.accuracy benchmark`: the methods of the paper and the defaults on every recording, for a release.

`python -m tests.accuracy.benchmark '{...}'` prints the row of one method on one recording as one line of JSON, or with
`{"unit": [...]}` the unit U, measured on a pair of images.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from importlib.metadata import version as installed
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import psutil

from ispom.child import end_with_parent
from ispom.evaluation.comparison import Delta
from ispom.evaluation.relative_error import motion_errors
from ispom.evaluation.trajectory_error import Alignment, error_against_truth, rms
from ispom.types import Trajectory

from .figures import Run, figures_of, rounded, run
from .records import Machine, Record, Row
from .unit import Unit

ROOT = Path(__file__).parents[2]
PACKAGES = ("numpy", "scipy", "opencv-python-headless", "numba")
"""Those that compute for the methods."""
LENGTHS = (100, 50, 20, 10, 5, 2, 1, 0.5, 0.2, 0.1)
"""Path lengths of the RPE, in the reference's unit."""
MIN_PARTS = 5
"""Least number of stretches of the RPE's length along a path: with fewer, single frames decide."""
STILL_S = 0.5
"""Time of the RPE's motions where the rig stands still [s]: half of the shortest recording of such a rig."""


def rpe_delta(truth: Trajectory) -> Delta:
    """Returns the distance of the RPE's motions: the longest that fits into the path, or a time where none does."""
    fitting = [each for each in LENGTHS if MIN_PARTS * each <= truth.length]
    return Delta(fitting[0], "m") if fitting else Delta(STILL_S, "s")


def rpe_of(done: Run) -> dict[str, Any]:
    """Returns the RPE as a row has it; without figures where nothing was localised or too few poses are compared."""
    if done.truth is None:
        return {}
    delta = rpe_delta(done.truth)
    about: dict[str, Any] = {"rpe_over": f"{delta.value:g}{' s' if delta.unit == 's' else ''}"}
    kind: Alignment = done.report["aligned"]
    error = error_against_truth(done.trajectory, done.truth, done.rig, kind) if done.located else None
    if error is None:
        return about
    translation, rotation_rad = motion_errors(error.aligned, error.reference, *delta.motions(error.reference))
    if not len(translation):
        return about
    share = 1.0 if delta.unit == "s" else 100 / delta.value
    return about | {"rpe": rounded(share * rms(translation)), "rpe_deg": rounded(rms(np.degrees(rotation_rad)))}


def measure(name: str, source: str, method: str) -> Row:
    """Runs one method over a recording."""
    return row_of(name, method, run(name, source, method))


def row_of(name: str, method: str, done: Run) -> Row:
    """Returns the row of a run."""
    figures, median = figures_of(done), done.report["ms_per_exposure"]["median"]
    return Row(
        recording=name,
        method=method,
        refused=None if done.located else done.report.get("never_located", "no check says why"),
        frames=figures.frames,
        located=figures.located,
        lost=done.report["lost"],
        segments=figures.segments,
        ms=None if median is None else rounded(median, 3),
        cpu_s=figures.seconds,
        alignment=figures.alignment,
        path=figures.path,
        ate=figures.ate,
        segment_ate=figures.segment_ate,
        **rpe_of(done),
    )


def row_text(row: Row) -> str:
    """Returns one row as a line."""
    if row.failed is not None:
        return f"{row.recording}, {row.method}: {row.failed}"
    parts = [f"{row.recording}, {row.method}: {row.located} of {row.frames} frames located, lost in {row.lost}"]
    parts += [f"ATE {row.ate:g}"] if row.ate is not None else []
    parts += [f"RPE {row.rpe:g} over {row.rpe_over}"] if row.rpe is not None else []
    parts += [f"{row.ms:g} CPU-ms per frame"] if row.ms is not None else []
    return ", ".join(parts)


def unit_pair(data: Path) -> list[str]:
    """Returns the two images on which U is measured, below the folder of recordings; they may be missing."""
    return [str(data / "kitti/sequences/06/image_0" / f"{i:06d}.png") for i in range(2)]


def commit() -> str:
    """Returns Git's name of the code, and whether files were changed; "unknown" outside a repository."""
    try:
        name = _git("rev-parse", "HEAD")
        return name + (" and changes" if _git("status", "--porcelain") else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()


def load() -> float | None:
    """Returns the mean number of processes that wanted a core in the last five minutes; None where unknown."""
    return os.getloadavg()[1] if hasattr(os, "getloadavg") else None


def machine(unit: dict[str, Any], loads: Sequence[float | None]) -> Machine:
    """Describes this machine; `unit` is what `main` prints of U, and `loads` were measured meanwhile."""
    known = [each for each in loads if each is not None]
    return Machine(
        processor=processor(),
        cores=psutil.cpu_count() or 1,
        memory_gb=rounded(psutil.virtual_memory().total / 1e9, 3),
        system=platform.platform(terse=True),
        python=platform.python_version(),
        packages={name: installed(name) for name in PACKAGES},
        unit_ms=rounded(unit["ms"], 3),
        unit_pair=unit["pair"],
        load=rounded(sum(known) / len(known), 2) if known else None,
    )


def processor() -> str:
    """Returns the name of the processor."""
    listed = Path("/proc/cpuinfo")
    lines = listed.read_text(encoding="utf-8").split("\n") if listed.is_file() else []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, "") or platform.processor() or platform.machine()


def record(version: str, code: str, measured_on: Machine, rows: list[Row], left_out: Iterable[str]) -> Record:
    """Returns the record of a release, measured today."""
    return Record(
        version=version,
        date=datetime.now(UTC).date().isoformat(),
        commit=code,
        command=f"python -m tests.accuracy benchmark --release {version}",
        machine=measured_on,
        left_out=sorted(left_out),
        rows=rows,
    )


def main(argument: str) -> None:
    task = json.loads(argument)
    cv2.setNumThreads(1)
    if "unit" in task:
        unit = Unit(tuple(map(Path, task["unit"])))
        unit.measure()
        found: Any = {"ms": unit.ms, "pair": unit.pair_name}
    else:
        found = msgspec.to_builtins(measure(task["name"], task["source"], task["method"]))
    sys.stdout.write(json.dumps(found) + "\n")


if __name__ == "__main__":
    end_with_parent()
    main(sys.argv[1])
