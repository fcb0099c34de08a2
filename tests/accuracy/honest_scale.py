"""`python -m tests.accuracy scale`: whether the scale within a segment changes by no more than the method states.

A segment of a monocular trajectory has one unit. Estimated over true length, in successive parts of a segment, must be
the same within three stated standard deviations, and within the factor that a segment promises.
`python -m tests.accuracy.honest_scale '{...}'` prints the rows of one recording as one line of JSON.
"""

from __future__ import annotations

import itertools
import json
import math
import sys
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from ispom.child import end_with_parent
from ispom.ensemble import build
from ispom.estimators.modern.monocular.keyframe import KEPT_WITHIN
from ispom.geometry import Array
from ispom.methods import Config
from ispom.types import Status, Step, Trajectory

from .figures import opened

SIGMAS = 3.0
"""Stated standard deviations by which the scale of a part may differ from that of its segment."""
LEAST_STEPS, MOST_PARTS = 4, 10
"""Steps of a part, over which the errors of single poses average out, and the most parts of a segment."""
STRAIGHT = 0.5
"""Least length of a part's chord relative to its way: the chord of a way that returns is mostly error."""
REFERENCE_SIGMA = 0.03
"""Standard deviation of ln of the length of a reference's chord: other programs' poses tremble by a tenth of a step."""


@dataclass(frozen=True)
class SegmentScale:
    """The scale of one segment."""

    first: int
    """Its first located frame."""
    last: int
    parts: int
    """Those that were long and straight enough; with fewer than two nothing can be said."""
    factor: float
    """Largest ratio of the scale of a part to the median of all, or its inverse."""
    sigmas: float
    """The largest difference of ln scale in stated standard deviations."""
    at: int
    """The first frame of the part with the largest difference."""

    @property
    def honest(self) -> bool:
        return self.parts < 2 or (self.sigmas <= SIGMAS and self.factor <= KEPT_WITHIN)


def segments_of(steps: Sequence[Step]) -> list[list[int]]:
    """Returns the indices of the located frames of each segment, in order; a part that joins an earlier segment belongs
    to that."""
    found, count, segment = dict[int, list[int]](), 0, 0
    for index, step in enumerate(steps):
        if step.restarted:
            count += 1
            segment = count
        if step.joins is not None:
            segment = step.joins
        if step.status == Status.TRACKING and step.world_from_frame is not None:
            found.setdefault(segment, []).append(index)
    return [found[key] for key in sorted(found)]


def scales(steps: Sequence[Step], truth: Trajectory) -> list[SegmentScale]:
    """Judges each segment by the poses as they were reported, where the truth has the same times."""
    places = dict(zip(truth.times_ns.tolist(), truth.translations, strict=True))
    found = []
    for indices in segments_of(steps):
        known = [i for i in indices if steps[i].time_ns in places]
        found += [] if not known else [_judged(steps, known, places)]
    return found


def _judged(steps: Sequence[Step], indices: list[int], places: dict[int, Array]) -> SegmentScale:
    count = min(MOST_PARTS, (len(indices) - 1) // LEAST_STEPS)
    ends = np.linspace(0, len(indices) - 1, count + 1).round().astype(int) if count else []
    rows = []
    for a, b in itertools.pairwise(ends):
        part = indices[a : b + 1]
        own = np.array([_centre(steps[i]) for i in part])
        true = np.array([places[steps[i].time_ns] for i in part])
        chord, way = np.linalg.norm(true[-1] - true[0]), np.linalg.norm(np.diff(true, axis=0), axis=1).sum()
        if chord < STRAIGHT * way or chord == 0:
            continue
        length = max(float(np.linalg.norm(own[-1] - own[0])), 1e-12)
        stated = [s.scale_sigma for i in range(indices[0], part[-1] + 1) if (s := steps[i]).scale_sigma is not None]
        rows.append((part[0], math.log(length / chord), stated[-1] if stated else 0.0))
    if len(rows) < 2:
        return SegmentScale(indices[0], indices[-1], len(rows), 1.0, 0.0, indices[0])
    off = np.abs(np.array([ln for _, ln, _ in rows]) - np.median([ln for _, ln, _ in rows]))
    sigmas = off / np.hypot([sigma for *_, sigma in rows], REFERENCE_SIGMA)
    worst = int(np.argmax(off))
    return SegmentScale(
        indices[0], indices[-1], len(rows), float(np.exp(off[worst])), float(sigmas.max()), rows[worst][0]
    )


def _centre(step: Step) -> Array:
    pose = step.world_from_frame
    return np.zeros(3) if pose is None else pose.translation


def measure(name: str, source: str) -> list[dict[str, Any]]:
    """Runs monocular with its default settings over a whole recording; no rows without truth."""
    sequence = opened(name, source)
    if sequence.truth is None or "video" not in sequence.kinds:
        return []
    ensemble = build(Config(), ("monocular",), sequence.rig)
    state, steps = ensemble.start(), list[Step]()
    for i in (i for i, kind in enumerate(sequence.kinds) if kind == "video"):
        state, made = ensemble.step(state, sequence[i])
        steps += made
    frames, located = len(steps), sum(step.status == Status.TRACKING for step in steps)
    about = {"recording": name, "frames": frames, "located": located}
    return [{**about, **asdict(scale), "honest": scale.honest} for scale in scales(steps, sequence.truth)]


def print_scales(console: Console, rows: Iterable[dict[str, Any]]) -> None:
    """One line for each recording."""
    table = Table("recording", "located", "segments", "judged", "not honest", "largest factor", "sigmas", "at frame")
    by = dict[str, list[dict[str, Any]]]()
    for row in rows:
        by.setdefault(row["recording"], []).append(row)
    for name, found in by.items():
        judged = [row for row in found if row["parts"] >= 2]
        wrong = sum(not row["honest"] for row in judged)
        worst = max(judged, key=lambda row: row["factor"], default=None)
        said = ("", "", "") if worst is None else (f"{worst['factor']:.3f}", f"{worst['sigmas']:.1f}", str(worst["at"]))
        located = f"{found[0]['located']} of {found[0]['frames']}"
        table.add_row(name, located, str(len(found)), str(len(judged)), str(wrong), *said)
    console.print(table)


def main(argument: str) -> None:
    task = json.loads(argument)
    cv2.setNumThreads(1)
    sys.stdout.write(json.dumps(measure(task["name"], task["source"])) + "\n")


if __name__ == "__main__":
    end_with_parent()
    main(sys.argv[1])
