"""`python -m tests.accuracy starts`: whether first maps are right, started at many frames.

A start is right where the camera's path up to some frames after the first map has the true shape and turns.
`python -m tests.accuracy.starts '{...}'` prints what was found as one line of JSON.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any, Literal

import cv2
import numpy as np
from rich.console import Console

from ispom.child import end_with_parent
from ispom.ensemble import build
from ispom.evaluation.trajectory_error import aligned, associate, ate_m, rms
from ispom.geometry import rotation_angle_rad
from ispom.methods import Config
from ispom.sequences import open_sequence
from ispom.types import Measurement, Sequence, Status, Trajectory

EVERY = {"handheld": 5, "kitti-06": 1, "kitti-00": 5, "sim:tiny": 5, "sim:city": 6, "sim:indoor": 8}
"""From one start to the next, in frames: of `CLIPS`, and of whole simulations."""
AFTER = 15
"""Frames after the first map that are judged with it."""
LONGEST = 120
"""Frames, from the start on, in which a map is awaited."""
MOST_ERROR, MOST_TURN_DEG = 0.08, 3.0
"""A right start is no farther off: as a share of the path's spread, and in any turn since the start."""


@dataclass(frozen=True)
class Started:
    source: str
    frame: int
    """Where it started."""
    outcome: Literal["map", "none"]
    frames: int
    """From the start to the first map, or to the end where there was none."""
    error: float = float("nan")
    """Root mean square distance after alignment with scale, over the spread of the true places."""
    turn_deg: float = float("nan")
    """Largest error of the turn since the start."""

    @property
    def wrong(self) -> bool:
        return self.outcome == "map" and not (self.error <= MOST_ERROR and self.turn_deg <= MOST_TURN_DEG)


def starts(source: str, last: int | None, every: int) -> Iterator[Started]:
    """At every such frame of the video, of its first ones until `last` where that is given, but for the very last."""
    sequence = open_sequence(source)
    assert sequence.truth is not None
    truth = sequence.truth.moved(right=sequence.rig.rig_from_video, frame="video")
    video = [i for i, kind in enumerate(sequence.kinds) if kind == "video"]
    kept = dict[int, Measurement]()
    for frame in range(0, len(video[:last]) - AFTER, every):
        kept = {i: e for i, e in kept.items() if i >= video[frame]}
        yield _started(source, sequence, truth, video[frame:], frame, kept)


def _started(
    source: str, sequence: Sequence, truth: Trajectory, video: list[int], frame: int, kept: dict[int, Measurement]
) -> Started:
    ensemble = build(Config(), ("monocular",), sequence.rig)
    state, mapped = ensemble.start(), None
    for count, i in enumerate(video[: LONGEST + AFTER]):
        kept[i] = kept[i] if i in kept else sequence[i]
        state, steps = ensemble.step(state, kept[i])
        if mapped is None and any(step.status is Status.TRACKING for step in steps):
            mapped = count
        if count >= LONGEST if mapped is None else count >= mapped + AFTER:
            break
    if mapped is None:
        return Started(source, frame, "none", count)
    own, true = associate(ensemble.finish(state)["monocular"], truth)
    placed = aligned(own, true, "sim3")
    spread = rms(np.linalg.norm(true.translations - true.translations.mean(axis=0), axis=1))
    since, wanted = (each.rotations[0].T @ each.rotations for each in (own, true))
    turns = [rotation_angle_rad(a.T @ b) for a, b in zip(since, wanted, strict=True)]
    return Started(source, frame, "map", mapped, ate_m(placed, true) / spread, float(np.degrees(max(turns))))


def print_starts(console: Console, found: list[Started]) -> None:
    """What all of a source come to, and those that are wrong."""
    maps = [s for s in found if s.outcome == "map"]
    right = sum(not s.wrong for s in maps)
    console.print(f"{found[0].source}: {right} of {len(maps)} first maps right; no map in {len(found) - len(maps)}")
    for s in maps:
        if s.wrong:
            console.print(f"  from frame {s.frame}: after {s.frames} frames, {s.error:.1%}, {s.turn_deg:.1f} degrees")


def starts_found(rows: list[dict[str, Any]]) -> list[Started]:
    """What a process printed."""
    return [Started(**row) for row in rows]


def main(argument: str) -> None:
    task = json.loads(argument)
    cv2.setNumThreads(1)
    found = starts(task["source"], task["last"], task["every"])
    sys.stdout.write(json.dumps([asdict(s) for s in found]) + "\n")


if __name__ == "__main__":
    end_with_parent()
    main(sys.argv[1])
