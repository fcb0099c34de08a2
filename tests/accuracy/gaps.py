"""`python -m tests.accuracy gaps`: a stretch is cut out of a flight or a drive, in which the camera may turn.

Where enough of what was seen before the gap is seen again, a method should know where it is, as well as without the
gap; else what follows should be a segment of its own. `python -m tests.accuracy.gaps '{...}'` prints what was found as
one line of JSON.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from ispom.child import end_with_parent
from ispom.ensemble import Ensemble, build
from ispom.features.row_search import PointSearch
from ispom.features.shi_tomasi import detect_corners
from ispom.geometry import Array, Pose
from ispom.methods import Config
from ispom.sequences import open_sequence
from ispom.simulation.cameras import simulated_rig
from ispom.simulation.motions import Motion, motion_of
from ispom.simulation.places.city import build_city
from ispom.simulation.places.town import build_town
from ispom.simulation.rendering.renderer import Renderer
from ispom.solvers.trajectory.alignment import umeyama
from ispom.types import Camera, Frame, FrameName, Measurement, Rig, Status, Step, Trajectory, is_stereo

from .flights import FilmedMethod, Flight

Place = Literal["city", "town"]
GAPS_S, TURNS_DEG = (1.0, 2.0, 3.0, 5.0, 7.0), (0.0, 20.0, 45.0, 90.0)
DRIVE_STARTS_S, DRIVE_GAPS_S = (1.0, 1.6, 2.2), (0.5, 1.0, 1.5, 2.0)
BEFORE_S, AFTER_S = 4.0, 1.4
"""What is seen before the gap and after it."""
SEEN_AGAIN = 0.3
"""Share of the last points that the image after the gap shows as well, from which on a method should know its place."""
WORSE = 2.0
"""Times the error without the gap that is allowed."""
LEAST_ERROR = 0.01
"""Share of the way across the gap that is no error to speak of, where the error without it happens to be smaller."""
SCALES = {"monocular": 1.0, "stereo": 0.5}
"""Of the simulated images: 640x480 for each."""
GAP_SEEDS: dict[Place, int] = {"city": 3, "town": 1}
"""Of sim:city and sim:town."""


@dataclass(frozen=True)
class Trial:
    source: str
    method: FilmedMethod
    start_s: float
    """The gap's begin."""
    gap_s: float
    turn_deg: float = 0.0
    """About the vertical axis, while nothing is seen."""


@dataclass(frozen=True)
class Found:
    trial: Trial
    seen_again: float
    """Share of the last image's points."""
    outcome: Literal["located", "segment", "lost"]
    error_m: float
    """Root mean square after the gap, aligned by what was before it; nan where not located."""
    allowed_m: float

    @property
    def right(self) -> bool:
        return self.error_m <= self.allowed_m if self.outcome == "located" else self.seen_again < SEEN_AGAIN


@dataclass(frozen=True)
class Turned:
    """A motion with the rig turned by an angle beside it from a time on."""

    motion: Motion
    from_s: float
    turn_deg: float

    def pose_at(self, time_ns: int) -> Pose:
        """world_from_rig."""
        turn = np.radians([0.0, self.turn_deg if time_ns * 1e-9 >= self.from_s else 0.0, 0.0])
        return self.motion.pose_at(time_ns) @ Pose.from_rotvec(turn, np.zeros(3))


@dataclass(frozen=True, eq=False)
class Case:
    """One method over one source without gaps, from which the gaps are cut."""

    method: FilmedMethod
    ensemble: Ensemble
    exposures: list[Measurement]
    truth: Trajectory
    """Of the frame whose poses the method gives."""
    states: list[Any]
    """Before each exposure."""
    steps: list[Step]
    final: Trajectory

    @staticmethod
    def of(method: FilmedMethod, rig: Rig, exposures: list[Measurement], truth: Trajectory) -> Case:
        ensemble, states, steps = build(Config(), (method,), rig), list[Any](), list[Step]()
        state = ensemble.start()
        for exposure in exposures:
            states.append(state)
            state, new = ensemble.step(state, exposure)
            steps += new
        return Case(method, ensemble, exposures, truth, states, steps, ensemble.finish(state)[method])

    def tried(self, trial: Trial, seen: list[Measurement], truth: Trajectory, seen_again: float) -> Found:
        """What the method makes of `seen` after the gap, where the `truth` is this."""
        first = next(i for i, e in enumerate(self.exposures) if e.time_ns >= round(trial.start_s * 1e9))
        state, after, metric = self.states[first], list[Step](), self.method == "stereo"
        for exposure in seen:
            state, new = self.ensemble.step(state, exposure)
            after += new
        found, begin_ns = self.ensemble.finish(state)[self.method], self.steps[first - 1].time_ns
        tracked = [s.time_ns for s in after if s.status is Status.TRACKING]
        outcome = "segment" if any(s.restarted for s in after) else "located" if tracked else "lost"
        error = _error(found, truth, begin_ns, tracked, metric) if outcome == "located" else float("nan")
        times = [s.time_ns for s in self.steps[first:] if seen[0].time_ns <= s.time_ns <= seen[-1].time_ns]
        plain = _error(self.final, self.truth, begin_ns, times, metric)
        way = float(np.linalg.norm(_at(truth, seen[0].time_ns).translation - _at(truth, begin_ns).translation))
        return Found(trial, seen_again, outcome, error, max(WORSE * plain, LEAST_ERROR * way))


def _error(found: Trajectory, truth: Trajectory, until_ns: int, times_ns: list[int], metric: bool) -> float:
    """Root mean square at these times [m], aligned by the poses until then."""
    before = [t for t in found.times_ns.tolist() if t <= until_ns]
    own, true = (np.stack([_at(poses, t).translation for t in before]) for poses in (found, truth))
    onto = umeyama(own, true, with_scale=not metric)
    there = [t for t in times_ns if found.at(t) is not None]
    own, true = (np.stack([_at(poses, t).translation for t in there]) for poses in (found, truth))
    return float(np.sqrt(((onto.apply(own) - true) ** 2).sum(axis=1).mean()))


def _at(trajectory: Trajectory, time_ns: int) -> Pose:
    pose = trajectory.at(time_ns)
    assert pose is not None
    return pose


def simulated(method: FilmedMethod, place: Place, seed: int) -> Iterator[Found]:
    """Gaps and turns over one seed of sim:city or sim:town."""
    stereo, city = method == "stereo", place == "city"
    flight = Flight(seed, simulated_rig(SCALES[method]), motion_of("flight" if city else "loop", seed))
    renderer, rate_hz = Renderer((build_city if city else build_town)(seed)), 5.0 if stereo else 15.0
    side: FrameName = "left" if stereo else "video"
    given: FrameName = "rig" if stereo else "video"
    times = [round(i * 1e9 / rate_hz) for i in range(round((BEFORE_S + max(GAPS_S) + AFTER_S) * rate_hz) + 1)]
    case = Case.of(
        method, flight.rig, [flight.exposure(renderer, t, stereo) for t in times], flight.truth(times, given)
    )
    last_ns = max(t for t in times if t < round(BEFORE_S * 1e9))
    camera, mount = flight.rig.camera(side), flight.rig.rig_from(side)
    for gap_s in GAPS_S:
        for turn_deg in TURNS_DEG:
            trial = Trial(f"sim:{place} seed {seed}", method, BEFORE_S, gap_s, turn_deg)
            turned = replace(flight, motion=Turned(flight.motion, BEFORE_S + 0.5 * gap_s, turn_deg))
            after = [t for t in times if 0 <= t * 1e-9 - BEFORE_S - gap_s <= AFTER_S]
            seen = [turned.exposure(renderer, t, stereo) for t in after] if turn_deg else None
            seen = seen or [e for e in case.exposures if e.time_ns in after]
            before = [t for t in times if t <= last_ns]
            last, now = (turned.pose_at(t) @ mount for t in (last_ns, after[0]))
            again = _seen_again(camera, *_surface(renderer, camera, last), last, now, renderer.depth(camera, now))
            yield case.tried(trial, seen, turned.truth([*before, *after], given), again)


def _surface(renderer: Renderer, camera: Camera, world_from_camera: Pose) -> tuple[Array, Array]:
    """Pixels (N, 2) on a grid, and their depths (N,)."""
    depth = renderer.depth(camera, world_from_camera)
    row, column = (v.ravel() for v in np.mgrid[4 : camera.height : 12, 4 : camera.width : 12])
    return np.column_stack([column, row]).astype(float), depth[row, column]


def driven(method: FilmedMethod, folder: Path) -> Iterator[Found]:
    """Gaps in a drive with stereo pairs (KITTI), whose exposures are left out."""
    sequence = open_sequence(str(folder))
    assert sequence.truth is not None
    stereo = method == "stereo"
    all_pairs = [e for i, k in enumerate(sequence.kinds) if k == "stereo" and is_stereo(e := sequence[i])]
    pairs: dict[int, Frame] = {e.time_ns: e for e in all_pairs}
    kind = "stereo" if stereo else "video"
    exposures = [sequence[i] for i, k in enumerate(sequence.kinds) if k == kind]
    moved = sequence.truth if stereo else sequence.truth.moved(right=sequence.rig.rig_from_video, frame="video")
    case, camera = Case.of(method, sequence.rig, exposures, moved), sequence.rig.camera("left")
    begin_ns = exposures[0].time_ns
    for start_s in DRIVE_STARTS_S:
        for gap_s in DRIVE_GAPS_S:
            since = [(e.time_ns - begin_ns) * 1e-9 - start_s for e in exposures]
            seen = [e for e, s in zip(exposures, since, strict=True) if -1e-6 <= s - gap_s <= AFTER_S]
            last_ns = max(e.time_ns for e, s in zip(exposures, since, strict=True) if s < -1e-6)
            pair = pairs[last_ns]
            uv = detect_corners(pair.left, 500)
            disparity = PointSearch().search(pair.left, pair.right, uv).disparity_px
            good = disparity > 1.0
            depth = camera.fx * sequence.rig.baseline_m / disparity[good]
            last, now = (_at(sequence.truth, t) @ sequence.rig.rig_from_left for t in (last_ns, seen[0].time_ns))
            again = _seen_again(camera, uv[good].astype(float), depth, last, now)
            yield case.tried(Trial(f"{folder.name}", method, start_s, gap_s), seen, moved, again)


def _seen_again(camera: Camera, uv: Array, depth: Array, last: Pose, now: Pose, surface: Array | None = None) -> float:
    """Share of the points at pixels (N, 2) and depths (N,) of the last image that another one (world_from_camera)
    shows, too: before what its own depths (H, W) say, where they are known."""
    rays = np.column_stack([camera.normalise(uv), np.ones(len(uv))])
    near = now.inverse().apply(last.apply(rays * np.where(np.isfinite(depth), depth, 1e4)[:, None]))
    place = camera.project(near)
    inside = ((place >= 0) & (place <= (camera.width - 1, camera.height - 1))).all(axis=1) & (near[:, 2] > 0)
    if surface is not None:
        column, row = np.rint(np.where(inside[:, None], place, 0)).astype(int).T
        inside &= near[:, 2] < 1.05 * surface[row, column] + 0.1
    return float(inside.mean())


def print_gaps(console: Console, found: list[Found]) -> None:
    """A table of all trials of one method, and what it comes to."""
    table = Table("source", "from s", "gap s", "turn", "seen again", "outcome", "error m", "allowed", "", box=None)
    for f in found:
        t = f.trial
        cells = (f"{t.start_s:g}", f"{t.gap_s:g}", f"{t.turn_deg:g}", f"{100 * f.seen_again:.0f} %", f.outcome)
        table.add_row(t.source, *cells, f"{f.error_m:.3f}", f"{f.allowed_m:.3f}", "" if f.right else "!")
    console.print(table)
    wanted = [f for f in found if f.seen_again >= SEEN_AGAIN]
    right, others = sum(f.right and f.outcome == "located" for f in wanted), [f for f in found if f not in wanted]
    blind = sum(f.outcome == "located" and f.error_m > f.allowed_m for f in found)
    console.print(
        f"{found[0].trial.method}: where at least {SEEN_AGAIN:.0%} of the last image is seen again, located within "
        f"{WORSE:g} times the error without the gap in {right} of {len(wanted)}; else "
        f"{sum(f.outcome == 'located' for f in others)} of {len(others)} located; located with a larger error: {blind}."
    )


def gaps_found(rows: list[dict[str, Any]]) -> list[Found]:
    """What a process printed."""
    return [Found(**{**row, "trial": Trial(**row["trial"])}) for row in rows]


def main(argument: str) -> None:
    task = json.loads(argument)
    cv2.setNumThreads(1)
    method = task["method"]
    found = driven(method, Path(task["folder"])) if "folder" in task else simulated(method, task["place"], task["seed"])
    sys.stdout.write(json.dumps([asdict(f) for f in found]) + "\n")


if __name__ == "__main__":
    end_with_parent()
    main(sys.argv[1])
