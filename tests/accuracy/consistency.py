"""`python -m tests.accuracy consistency`: the covariances of the poses against simulated truth, over seeds.

`python -m tests.accuracy.consistency '{...}'` prints what was found as one line of JSON.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from ispom.child import end_with_parent
from ispom.ensemble import build
from ispom.methods import Config
from ispom.methods import method as registered
from ispom.sequences.formats.simulated import open_simulated
from ispom.simulation.scenario.scenario import World
from ispom.types import Sequence, Step
from tests.nees import PARTS, Errors, consistency, errors

from .miscalibrated import miscalibrated


@dataclass(frozen=True)
class Flight:
    """A way through a simulated place, as every seed makes it anew."""

    title: str
    scene: str
    duration_s: float
    """[s] As long as twenty seeds are rendered within half an hour."""
    world: World = World()


FLIGHTS = {
    "sim:tiny": Flight("sim:tiny", "tiny", 6.0),
    "sim:indoor": Flight("sim:indoor in images of sim:tiny's size", "tiny", 6.0, World(place="indoor", motion="walk")),
    "sim:city": Flight("sim:city", "city", 4.0),
}
AXES = ("x", "y", "z", "about x", "about y", "about z")
UNIT = {"own": "thousandths of its unit", "metric": "mm"}
GAUGE = {
    "own": "Relative to the first pose and the length of the map's first baseline, to which the truth is scaled.",
    "metric": "Relative to the first pose, in metres.",
}
"""Nothing is aligned with the truth, which would take part of the error away: poses are compared in the gauge that they
are estimated in."""


KNOWN = {
    "exact": "exact cameras",
    "drawn": "cameras off by what the settings allow for",
    "untold": "exact cameras, whose rig does not say so",
}
"""What is known of the cameras is true in the first two, as NEES asks for: that they are what the rig says, or that
they are off by as much as the deviations of the settings, each seed otherwise. In the last one they are better than
that, as those of a good calibration are: there covariances are wider than errors."""


def measured(method: str, scene: str, cameras: str, seeds: int, folder: Path) -> dict[str, Any]:
    """By part of the pose: NEES over the seeds; empty where the method gives no covariances. `cameras`: of KNOWN."""
    cv2.setNumThreads(1)
    runs = list[Errors]()
    for seed in range(seeds):
        runs.append(errors_of_run(_known(flown(scene, seed, folder), seed, cameras), method))
        if not len(runs[0].times_ns):
            return {}
    found = {name: consistency(runs, part) for name, part in PARTS.items()}
    given = {name: c for name, c in found.items() if c is not None}
    summary: dict[str, Any] = {n: {**asdict(c), "sigma_factor": c.sigma_factor} for n, c in given.items()}
    return summary | {"per_axis": _per_axis(runs), "rms": _rms(runs)} if summary else {}


def flown(scene: str, seed: int, folder: Path) -> Sequence:
    """Returns a flight of FLIGHTS, rendered below a folder."""
    flight = FLIGHTS[scene]
    place = folder / flight.title / str(seed)
    return open_simulated(flight.scene, seed, place, duration_s=flight.duration_s, world=flight.world)


def _known(sequence: Sequence, seed: int, cameras: str) -> Sequence:
    """The sequence with what `cameras`, of KNOWN, says of its rig."""
    if cameras == "drawn":
        return miscalibrated(sequence, seed)
    if cameras == "untold":
        return replace(sequence, rig=sequence.rig.changed(video_sigma=None, pair_sigma=None))
    return sequence


def errors_of_run(sequence: Sequence, method: str) -> Errors:
    """Returns the errors of one run in the method's gauge; none where it states no covariance."""
    ensemble = build(Config(), (method,), sequence.rig)
    state, given = ensemble.start(), list[Step]()
    for i, kind in enumerate(sequence.kinds):
        if kind in registered(method).sensors:
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


def _rms(runs: list[Errors]) -> float:
    """Root mean square of the position's error."""
    return float(np.sqrt(np.mean(np.concatenate([(run.twists[:, :3] ** 2).sum(axis=1) for run in runs]))))


def print_consistency(console: Console, method: str, cameras: str, by_scene: dict[str, dict[str, Any]]) -> None:
    """What was found of a method with `cameras` (a key of KNOWN), by the keys of FLIGHTS."""
    failed = next((found["error"] for found in by_scene.values() if "error" in found), None)
    by_scene = {scene: found for scene, found in by_scene.items() if found}
    if failed or not by_scene:
        console.print(f"{method}: {failed or 'gives no covariances'}")
        return
    heads = ("", "NEES", "of", "band", "in/above/below", "longest", "sigma x")
    table = Table(f"{method}, {KNOWN[cameras]}", *heads, box=None, pad_edge=False)
    for scene, found in by_scene.items():
        for part in PARTS:
            table.add_row(scene if part == "pose" else "", part, *_cells(found[part]))
    console.print(table)
    for scene, found in by_scene.items():
        flight = FLIGHTS[scene]
        axes = ", ".join(f"{axis} {factor:.2f}" for axis, factor in zip(AXES, found["per_axis"], strict=True))
        off = f"off by {1e3 * found['rms']:.2g} {UNIT[registered(method).unit]}"
        console.print(
            f"{found['pose']['runs']} seeds of {flight.title}, {flight.duration_s:g} s, {off}; of each axis: {axes}."
        )
    console.print(
        f"The mean over the seeds should lie in its 95 % band at about 95 % of the times (longest: the longest stretch "
        "above it); sigma x: what the standard deviations should be multiplied by. "
        f"{GAUGE[registered(method).unit]}\n"
    )


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    low, high = row["band"]
    shares = "/".join(f"{100 * row[share]:.0f}" for share in ("inside", "above", "below"))
    ends = (f"{shares} %", f"{row['longest_above_s']:.1f} s", f"{row['sigma_factor']:.2f}")
    return (f"{row['average']:.2f}", str(row["dof"]), f"{low:.2f}-{high:.2f}", *ends)


def main(argument: str) -> None:
    task = json.loads(argument)
    found = measured(task["method"], task["scene"], task["cameras"], task["seeds"], Path(task["folder"]))
    sys.stdout.write(json.dumps(found) + "\n")


if __name__ == "__main__":
    end_with_parent()
    main(sys.argv[1])
