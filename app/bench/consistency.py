"""`ispom bench --consistency`: the covariances of the poses against simulated truth, over seeds.

`python -m ispom_app.bench.consistency '{...}'` prints what was found as one line of JSON.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from ispom.evaluation.consistency import PARTS, Errors, consistency, errors
from ispom.methods import method as registered
from ispom.sequences.formats.simulated import open_simulated
from ispom.types import Sequence, Step

from .measure import ensemble_of

DURATION_S = 8.0
"""Of each flight: sim:tiny, longer than it is by itself."""
AXES = ("x", "y", "z", "about x", "about y", "about z")
GAUGE = {
    "own": "Relative to the first pose and the length of the map's first baseline, to which the truth is scaled.",
    "metric": "Relative to the first pose, in metres.",
}
"""Nothing is aligned with the truth, which would take part of the error away: poses are compared in the gauge that they
are estimated in."""


def measured(method: str, seeds: int, folder: Path) -> dict[str, Any]:
    """By part of the pose: NEES over the seeds; empty where the method gives no covariances."""
    cv2.setNumThreads(1)
    runs: list[Errors] = []
    for seed in range(seeds):
        runs.append(_errors(open_simulated("tiny", seed, folder / str(seed), duration_s=DURATION_S), method))
        if not len(runs[0].times_ns):
            return {}
    found = {name: consistency(runs, part) for name, part in PARTS.items()}
    given = {name: c for name, c in found.items() if c is not None}
    summary: dict[str, Any] = {n: {**asdict(c), "sigma_factor": c.sigma_factor} for n, c in given.items()}
    return summary | {"per_axis": _per_axis(runs)} if summary else {}


def _errors(sequence: Sequence, method: str) -> Errors:
    ensemble = ensemble_of(method, sequence.rig)
    state, given = ensemble.start(), list[Step]()
    for i, kind in enumerate(sequence.kinds):
        if kind in registered(method).needs:
            state, steps = ensemble.step(state, sequence[i])
            given += steps
    assert sequence.truth is not None
    if registered(method).unit == "own":
        return errors(given, sequence.truth.moved(right=sequence.rig.rig_from_video), own_unit=True)
    return errors(given, sequence.truth)


def _per_axis(runs: list[Errors]) -> list[float]:
    """(6,) root mean square of each component of the error over its standard deviation."""
    twists = np.concatenate([run.twists for run in runs])
    variances = np.concatenate([np.diagonal(run.covariances, axis1=1, axis2=2) for run in runs])
    return np.sqrt(np.mean(twists**2 / variances, axis=0)).tolist()


def print_consistency(console: Console, method: str, found: dict[str, Any]) -> None:
    if "error" in found or not found:
        console.print(f"{method}: {found.get('error', 'gives no covariances')}")
        return
    runs = found["pose"]["runs"]
    table = Table(
        method, "NEES", "of", "band of the mean", "times inside", "above", "sigma x", box=None, pad_edge=False
    )
    for part in PARTS:
        row = found[part]
        low, high = row["band"]
        cells = (f"{row['average']:.2f}", str(row["dof"]), f"{low:.2f} to {high:.2f}", f"{100 * row['inside']:.0f} %")
        table.add_row(part, *cells, f"{100 * row['above']:.0f} %", f"{row['sigma_factor']:.2f}")
    console.print(table)
    axes = ", ".join(f"{axis} {factor:.2f}" for axis, factor in zip(AXES, found["per_axis"], strict=True))
    console.print(
        f"{runs} seeds of sim:tiny, {DURATION_S:g} s. The mean over the seeds should lie in its 95 % band at about "
        f"95 % of the times; sigma x: what the standard deviations should be multiplied by; of each axis: {axes}. "
        f"{GAUGE[registered(method).unit]}\n"
    )


def main(argument: str) -> None:
    task = json.loads(argument)
    found = measured(task["method"], task["seeds"], Path(task["folder"]))
    sys.stdout.write(json.dumps(found) + "\n")


if __name__ == "__main__":
    main(sys.argv[1])
