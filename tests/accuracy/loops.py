"""`python -m tests.accuracy loops`: simulated drives that come back to their start, and others that only look so.

The drives that come back go around sim:town's block (541 m), with loops and without. The others begin in the middle of
a street of equal houses and end before they are there again: what they see looks like what they saw at other places,
and every loop is a false one. `python -m tests.accuracy.loops '{...}'` prints what was found as one line of JSON.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from typing import Any

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from ispom.child import end_with_parent
from ispom.ensemble import Ensemble, build
from ispom.estimators.modern.loops.checks import LOOP_SHIFT
from ispom.evaluation.trajectory_error import rms
from ispom.geometry import Pose
from ispom.methods import Config
from ispom.simulation.cameras import simulated_rig
from ispom.simulation.motions import Motion, motion_of
from ispom.simulation.places.town import LAP_M, SPEED_M_S, build_town
from ispom.simulation.rendering.renderer import Renderer
from ispom.types import Frame, Rig, Step, Trajectory, is_stereo
from tests.nees import PARTS, band, errors

from .flights import FILMED_METHODS, FilmedMethod, Flight
from .terraces import build_terraces

SCALE, RATE_HZ = 0.3, 4.0
"""Of the simulated images: 384x288; 1.5 m from one to the next. One camera sees what the left one of the pair does."""
RETURNING = 1.06
"""Laps of a drive that comes back."""
BEGIN_M, SHORT_M = 66.0, 24.0
"""Where a drive by equal houses begins, along the lap, and by how much it ends before it is there again: more than two
views of one place may lie apart."""
START_M = 60.0
"""The way by whose true length one camera's unit is told: what is off at the end is drift."""
ERROR_SHARE = 1e-3
"""Of the way, that a loop may leave at the return."""


@dataclass(frozen=True)
class Driven:
    """What one method made of one drive."""

    method: FilmedMethod
    seed: int
    returns: bool
    way_m: float
    closed: int
    """Times that a loop was told."""
    error_m: float
    """At the end, with loops."""
    restarts: int = 0
    """Segments after the first one: without loops nothing joins them, and no covariance tells how they lie."""
    plain_error_m: float | None = None
    """The same without."""
    plain_nees: float | None = None
    """Of the position there: the squared error over the covariance's claim, 3 where that is right."""
    spread: float | None = None
    """Root mean square of the error over all poses, over that without loops."""

    @property
    def found(self) -> bool:
        return self.closed > 0 and self.error_m <= ERROR_SHARE * self.way_m


@dataclass(frozen=True)
class Later:
    """A motion that is joined under way."""

    motion: Motion
    by_ns: int

    def pose_at(self, time_ns: int) -> Pose:
        """world_from_rig."""
        return self.motion.pose_at(time_ns + self.by_ns)


@dataclass(eq=False)
class Run:
    """One method on its way; its Steps and where it is."""

    method: FilmedMethod
    ensemble: Ensemble
    state: dict[str, Any]
    steps: list[Step]

    @staticmethod
    def of(method: FilmedMethod, rig: Rig, loops: bool) -> Run:
        config = Config()
        config = config.with_settings(method, replace(config.of(method), loops=loops))
        ensemble = build(config, (method,), rig if method == "stereo" else Rig.single(rig.camera("left")))
        return Run(method, ensemble, ensemble.start(), [])

    def see(self, pair: Frame) -> None:
        exposure = pair if self.method == "stereo" else Frame.video(pair.time_ns, pair.left)
        self.state, new = self.ensemble.step(self.state, exposure)
        self.steps += new

    @property
    def found(self) -> Trajectory:
        return self.ensemble.finish(self.state)[self.method]


def driven(seed: int, returns: bool, methods: Iterable[FilmedMethod], lap: float = 1.0) -> list[Driven]:
    """Of each method on one drive, of which only a part is driven where `lap` is less."""
    lap_ns = LAP_M / SPEED_M_S * 1e9
    motion, scene = motion_of("loop", seed), build_town(seed) if returns else build_terraces(seed)
    motion = motion if returns else Later(motion, round(BEGIN_M / SPEED_M_S * 1e9))
    end_ns = lap * (RETURNING if returns else 1 - SHORT_M / LAP_M) * lap_ns
    times = [round(i * 1e9 / RATE_HZ) for i in range(int(end_ns * 1e-9 * RATE_HZ))]
    flight, renderer = Flight(seed, simulated_rig(SCALE), motion), Renderer(scene)
    runs = {m: [Run.of(m, flight.rig, loops) for loops in ((True, False) if returns else (True,))] for m in methods}
    for time_ns in times:
        pair = flight.exposure(renderer, time_ns, stereo=True)
        assert is_stereo(pair)
        for run in (r for some in runs.values() for r in some):
            run.see(pair)
    return [_judged(flight, times, returns, *some) for some in runs.values()]


def _judged(flight: Flight, times: list[int], returns: bool, run: Run, plain: Run | None = None) -> Driven:
    metric = run.method == "stereo"
    truth = flight.truth(times, "rig" if metric else "left")
    off = _off(run.found, truth, metric)
    closed = sum(d.key == LOOP_SHIFT.key for step in run.steps for d in step.decisions)
    restarts = sum(step.restarted for step in run.steps)
    done = Driven(run.method, flight.seed, returns, truth.length, closed, float(off[-1]), restarts)
    if plain is None:
        return done
    without = _off(plain.found, truth, metric)
    nees = errors(plain.steps, truth, own_unit=not metric).nees(PARTS["position"])
    last = float(nees[-1]) if len(nees) else None
    return replace(done, plain_error_m=float(without[-1]), plain_nees=last, spread=rms(off) / rms(without))


def _off(found: Trajectory, truth: Trajectory, metric: bool) -> np.ndarray:
    """(N,) distances of the poses from the true ones [m]: given the first pose, and of one camera the first 60 m."""
    true = [truth.at(t) for t in found.times_ns.tolist()]
    begin, first = true[0], found.pose(0)
    assert begin is not None
    own = first.inverse().apply(found.translations)
    moved = np.stack([begin.inverse().apply(pose.translation) for pose in true if pose is not None])
    if not metric:
        way = np.concatenate([[0.0], np.linalg.norm(np.diff(moved, axis=0), axis=1).cumsum()])
        there = way < START_M
        own *= (own[there] * moved[there]).sum() / (own[there] ** 2).sum()
    return np.linalg.norm(own - moved, axis=1)


def print_loops(console: Console, found: list[Driven]) -> None:
    """A table of all drives of one method, and what it comes to."""
    names = ("drive", "seed", "way m", "restarts", "loops", "error m", "without", "NEES", "all poses")
    table = Table(*names, box=None, pad_edge=False)
    for f in found:
        more = (f.plain_error_m, f.plain_nees, f.spread)
        name = "sim:town" if f.returns else "equal houses"
        cells = (
            f"{f.way_m:.0f}",
            str(f.restarts),
            str(f.closed),
            *("-" if v is None else f"{v:.2f}" for v in (f.error_m, *more)),
        )
        table.add_row(name, str(f.seed), *cells)
    console.print(table)
    back, others = [f for f in found if f.returns], [f for f in found if not f.returns]
    method = found[0].method
    if back:
        shares = [100 * f.error_m / f.way_m for f in back if f.found]
        worst = f", worst {max(shares):.3f} %" if shares else ""
        console.print(
            f"{method}: found, and within {ERROR_SHARE:.1%} of the way at the return, in "
            f"{sum(f.found for f in back)} of {len(back)}{worst}; {_drift(back)}"
        )
    if others:
        console.print(f"{method}: loops where houses are alike and nothing returns: {sum(f.closed for f in others)}")


def _drift(back: list[Driven]) -> str:
    """In words, without loops, of those in one segment."""
    back = [f for f in back if not f.restarts]
    shares = [100 * f.plain_error_m / f.way_m for f in back if f.plain_error_m is not None]
    nees = [f.plain_nees for f in back if f.plain_nees is not None]
    if not shares or not nees:
        return "without loops not measured"
    low, high = band(3, len(nees))
    return (
        f"without, where tracking never broke ({len(back)}), {np.median(shares):.3f} %, worst {max(shares):.3f} %; "
        f"its covariance: NEES {np.mean(nees):.2f}, {low:.2f} to {high:.2f} where it is right"
    )


def loops_found(rows: list[dict[str, Any]]) -> list[Driven]:
    """What a process printed."""
    return [Driven(**row) for row in rows]


def main(argument: str) -> None:
    task = json.loads(argument)
    cv2.setNumThreads(1)
    methods: list[FilmedMethod] = [m for m in FILMED_METHODS if m in task["methods"]]
    sys.stdout.write(json.dumps([asdict(d) for d in driven(task["seed"], task["returns"], methods)]) + "\n")


if __name__ == "__main__":
    end_with_parent()
    main(sys.argv[1])
