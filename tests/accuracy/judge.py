"""`python -m tests.accuracy judge`: from which size on `ispom judge` finds mistakes that are planted in true poses.

The poses are the ground truth of recordings below --data, and of simulations with seeds by which no constant of the
judge was chosen. Images are tracked once for each recording: only poses are changed.
`python -m tests.accuracy.judge '{...}'` prints what was found on one recording as one line of JSON.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from scipy.spatial.transform import Rotation

from ispom.child import end_with_parent
from ispom.evaluation.judge.evidence import of_chunks
from ispom.evaluation.judge.judgement import Judgement
from ispom.evaluation.judge.judgement import judge as judged
from ispom.evaluation.judge.poses import Change, changed, covered, distinct, drifted, turned
from ispom.evaluation.judge.tracks import chunks, main_camera, main_frames
from ispom.geometry import Array, Pose
from ispom.sequences import open_sequence
from ispom.types import Trajectory

from .page import write_between

REAL: Mapping[str, str] = {
    "KITTI 06": "kitti/sequences/06",
    "KITTI 00": "kitti/sequences/00",
    "handheld_board": "handheld_board",
    "EuRoC V1_01 start": "euroc_v1_01_start",
}
"""Recordings with truth: the folder below --data, by name."""
SIMULATED = (
    "sim:tiny?motion=flight&seed=101&duration_s=4",
    "sim:tiny?motion=walk&seed=102&duration_s=4",
    "sim:city?seed=103&duration_s=3",
    "sim:indoor?seed=104&duration_s=3",
)
PLACES = (0.35, 0.55)
"""Where jumps are, as shares of a recording: the ground truth itself is denied at the begin of KITTI's and at the end
of KITTI 00."""
TURNING_DEG_S = (0.3, 1.0, 3.0)
GROWING = (0.1, 0.3, 1.0)
JUMPS = (1.0, 3.0, 10.0, 30.0)
"""In median distances between neighbouring frames."""
WINDOWS = (3, 5, 9, 17)
"""Frames of a moving mean."""
CLOCKS_S = (0.01, -0.02, 0.05, -0.1)
SCALES = (1.1, 1.3, 1.6, 2.5)
MOUNTS_DEG = (1.0, 2.0, 5.0, 10.0)
AXES: Mapping[str, Array] = {
    "OpenGL": np.diag([1.0, -1.0, -1.0]),
    "ROS": np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]),
    "z up": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
}


@dataclass(frozen=True)
class Plant:
    """A mistake in the poses of all frames."""

    kind: str
    size: str
    applied: Callable[[Trajectory], Trajectory]
    names: tuple[str, ...]
    """Kinds of findings that name it."""
    frame: int | None = None
    """The first one after a jump or step."""


@dataclass(frozen=True)
class Found:
    recording: str
    kind: str
    """"" for the truth itself."""
    size: str
    named: bool
    """For the truth: whether there is no alarm."""
    contradicted: bool
    """Whether anything is found that is not found in the truth itself."""
    verdict: str
    what: tuple[str, ...] = ()
    """What was found that the truth has not."""
    misnamed: bool = False
    """Whether a cause of all poses is among that, which was not planted."""


def recordings_in(data: Path) -> dict[str, str]:
    """Sources by name: those below `data` that are there, and simulations."""
    there = {name: str(data / place) for name, place in REAL.items() if (data / place).is_dir()}
    return {**there, **{name: name for name in SIMULATED}}


def plants(truth: Trajectory, seed: int) -> Iterator[Plant]:
    """Yields mistakes that can be made in poses of all frames; `seed` chooses their directions."""
    rng = np.random.default_rng(seed)

    def direction() -> Array:
        drawn = rng.normal(size=3)
        return drawn / np.linalg.norm(drawn)

    for rate in TURNING_DEG_S:
        change = Change(turning=np.radians(rate) * direction())
        yield Plant("drift of the turn", f"{rate:g} deg/s", _drifted(change), ("turning",))
    for rate in GROWING:
        yield Plant("drift of the scale", f"{rate:g} per s", _drifted(Change(growing=rate)), ("growing",))
    step = float(np.median(np.linalg.norm(np.diff(truth.translations, axis=0), axis=1)))
    for size in JUMPS:
        for place in PLACES:
            frame = round(place * len(truth))
            moved = _jumped(frame, size * step * direction())
            yield Plant("jump", f"{size:g} steps", moved, ("motion", "scale", "rest"), frame)
    for window in WINDOWS:
        yield Plant("smoothing", f"{window} frames", _smoothed(window), ("smoothing",))
    for seconds in CLOCKS_S:
        yield Plant("clock", f"{abs(seconds) * 1e3:g} ms", _late(seconds), ("clock",))
    for name, axes in AXES.items():
        yield Plant("axes", name, _turned(axes), ("axes",))
    for factor in SCALES:
        frame = len(truth) // 2
        yield Plant("step of the scale", f"factor {factor:g}", _scaled(frame, factor), ("scale", "motion"), frame)
    for degrees in MOUNTS_DEG:
        yield Plant("mount", f"{degrees:g} deg", _turned(turned(np.radians(degrees) * direction())), ("mount",))


def _drifted(change: Change) -> Callable[[Trajectory], Trajectory]:
    return lambda t: drifted(t, change)


def _jumped(frame: int, by: Array) -> Callable[[Trajectory], Trajectory]:
    return lambda t: replace(t, translations=t.translations + np.where(np.arange(len(t))[:, None] >= frame, by, 0.0))


def _scaled(frame: int, factor: float) -> Callable[[Trajectory], Trajectory]:
    def applied(t: Trajectory) -> Trajectory:
        after = np.arange(len(t))[:, None] >= frame
        return replace(t, translations=t.translations + after * (factor - 1) * (t.translations - t.translations[frame]))

    return applied


def _late(seconds: float) -> Callable[[Trajectory], Trajectory]:
    return lambda t: replace(t, times_ns=t.times_ns + round(seconds * 1e9))


def _turned(turn: Array) -> Callable[[Trajectory], Trajectory]:
    return lambda t: t.moved(right=Pose(turn, np.zeros(3)))


def _smoothed(window: int) -> Callable[[Trajectory], Trajectory]:
    """A moving mean of positions and rotations, over fewer frames at both ends."""

    def applied(t: Trajectory) -> Trajectory:
        near = [slice(max(0, k - window // 2), k + window // 2 + 1) for k in range(len(t))]
        rotations = [Rotation.from_matrix(t.rotations[n]).mean().as_matrix() for n in near]
        return replace(
            t, rotations=np.array(rotations), translations=np.array([t.translations[n].mean(0) for n in near])
        )

    return applied


def tried(name: str, source: str) -> Iterator[Found]:
    """The truth of a recording, and each mistake in it."""
    sequence = open_sequence(source)
    places = main_frames(sequence)
    times_ns = sequence.times_ns[places]
    assert sequence.truth is not None
    truth = distinct(sequence.truth)
    rig_from_camera = sequence.rig.rig_from(main_camera(sequence))
    frame = Change(mount=rig_from_camera.rotation, lever=rig_from_camera.translation)
    has_pose = covered(truth, times_ns)
    in_camera = changed(truth, times_ns, frame)
    tracked = list(chunks(sequence, places, lambda: None))

    def judgement(poses: Trajectory, known: NDArray[np.bool_]) -> Judgement:
        return judged(of_chunks(tracked, changed(poses, times_ns, Change()), known), poses, times_ns, known)

    own = judgement(in_camera, has_pose)
    yield Found(name, "", "", not _all(own), bool(_all(own)), own.verdict, _all(own))
    for plant in plants(in_camera, len(times_ns)):
        poses = plant.applied(in_camera)
        found = judgement(poses, has_pose & covered(poses, times_ns))
        new = _new(found, own)
        named = bool(_named(found, own, plant))
        others = _of_all_poses(found) - _of_all_poses(own) - set(plant.names)
        yield Found(name, plant.kind, plant.size, named, bool(new) or named, found.verdict, new, bool(others))


def _all(of: Judgement) -> tuple[str, ...]:
    smoothed = ("smoothing",) if of.smoothing is not None and of.smoothing.found else ()
    places = (f"{each.kind} at {each.first} to {each.last}" for each in of.denied)
    return (*(each.kind for each in of.tested if each.accepted), *smoothed, *places)


def _of_all_poses(of: Judgement) -> set[str]:
    return {text for text in _all(of) if " at " not in text}


def _new(found: Judgement, own: Judgement) -> tuple[str, ...]:
    """What is found that the truth has not: places in time are compared by whether they overlap."""
    places = (
        f"{each.kind} at {each.first} to {each.last}"
        for each in found.denied
        if not any(o.kind == each.kind and o.first <= each.last and each.first <= o.last for o in own.denied)
    )
    return (*sorted(_of_all_poses(found) - _of_all_poses(own)), *places)


def _named(found: Judgement, own: Judgement, plant: Plant) -> bool:
    """Checks whether a finding is of the planted kind, and at its place, and not of the truth as well."""
    frame = plant.frame
    if frame is None:
        return bool(set(plant.names) & (_of_all_poses(found) - _of_all_poses(own)))

    def there(of: Judgement) -> set[str]:
        return {each.kind for each in of.denied if each.first < frame <= each.last} & set(plant.names)

    return bool(there(found) - there(own))


def print_judge(console: Console, found: list[Found]) -> None:
    """The table, as the page has it."""
    console.print(markdown(found))


def write_judge(page: Path, found: list[Found]) -> None:
    """Replaces the table of a page of the documentation."""
    write_between(page, "judge", markdown(found))


def markdown(found: list[Found]) -> str:
    """How often each kind and size is named, on real recordings and simulated ones; and the truths with an alarm."""
    telling = [f for f in found if f.verdict != "cannot tell" or f.contradicted]
    quiet = {f.recording for f in found} - {f.recording for f in telling}
    planted = [f for f in found if f.kind and f.recording not in quiet]
    lines = [
        "| planted | size | named, simulated | contradicted | named, real | contradicted | another cause named, too |",
        "| --- " * 7 + "|",
    ]
    for kind, size in dict.fromkeys((f.kind, f.size) for f in planted):
        cells = []
        for simulated in (True, False):
            some = [
                f for f in planted if (f.kind, f.size) == (kind, size) and f.recording.startswith("sim:") == simulated
            ]
            cells += [f"{sum(hit)} of {len(hit)}" for hit in ([f.named for f in some], [f.contradicted for f in some])]
        others = [f.misnamed for f in planted if (f.kind, f.size) == (kind, size)]
        lines.append(f"| {kind} | {size} | {' | '.join(cells)} | {sum(others) or ''} |")
    truths = [f for f in found if not f.kind]
    alarms = [f for f in truths if f.contradicted]
    lines += ["", f"True poses with an alarm: {len(alarms)} of {len(truths)}.", ""]
    lines += [f"- {f.recording}: {'; '.join(f.what)}" for f in alarms]
    for name in sorted(quiet):
        own = [f for f in found if f.recording == name]
        lines.append(f"- {name}: it cannot tell, of the truth and of {len(own) - 1} others.")
    return "\n".join(lines).rstrip()


def judge_found(rows: list[dict[str, Any]]) -> list[Found]:
    """What a process printed."""
    return [Found(**{**row, "what": tuple(row["what"])}) for row in rows]


def main(argument: str) -> None:
    cv2.setNumThreads(1)
    task = json.loads(argument)
    found = tried(task["name"], task["source"])
    sys.stdout.write(json.dumps([asdict(f) for f in found]) + "\n")


if __name__ == "__main__":
    end_with_parent()
    main(sys.argv[1])
