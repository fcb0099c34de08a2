"""Reads the frames of a run's folder as records of the history."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from operator import attrgetter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Pose, Similarity
from ispom.methods import method as registered
from ispom.methods import names
from ispom.types import FrameName, Kind, Rig, Status, Step

from ...engine.history.quantities import POSE
from ...engine.history.record import ExposureRecord, MethodStatus
from ...engine.run_folder.placements import Placed
from ...engine.run_folder.run_folder import STEPS
from ...engine.run_folder.step_reader import StoredStep, stored_steps

MOST = 1_000_000
"""Most frames of a run: half a day of video."""


@dataclass(frozen=True, eq=False)
class Exposures:
    """Times and kinds of a run's frames."""

    times_ns: NDArray[np.int64]
    """(N,)."""
    kinds: tuple[Kind, ...]
    """(N,)."""
    used: NDArray[np.bool_]
    """(N,) whether the folder has the frame. Frames that no method used get times between those of their neighbours."""
    frames: Mapping[str, FrameName] = field(default_factory=dict)
    """By method: the frame (rig or camera) of the poses in its steps."""


def exposures(folder: Path, rig: Rig) -> Exposures:
    """Returns the frames up to the last one that a method used. InputError where the folder has no steps, or damaged
    ones."""
    latest_ns = 0
    times: dict[int, int] = {}
    kinds: dict[int, Kind] = {}
    frames: dict[str, FrameName] = {}
    steppers: dict[int, set[str]] = defaultdict(set)
    with stored_steps(folder) as steps:
        for step in steps:
            known = step.frame in rig.sensors or step.frame in ("world", "rig", "video", "left", "right")
            if step.exposure >= MOST or (times and step.time_ns < latest_ns) or not known:
                place = f"{folder / STEPS}: frame {step.exposure}"
                raise InputError(f"{place} is not as `ispom run` writes it: run again")
            latest_ns = times[step.exposure] = step.time_ns
            frames[step.method] = step.frame
            used = registered(step.method).sensors if step.method in names() else frozenset()
            if len(used) == 1:
                kinds.setdefault(step.exposure, *used)  # methods that run inside others come after them
            elif used:
                steppers[step.exposure].add(step.method)
    for exposure, methods in steppers.items():
        if exposure not in kinds and (kind := _kind(methods, set(frames))) is not None:
            kinds[exposure] = kind
    indices = np.arange(max(times, default=-1) + 1)
    known = np.array(sorted(times), np.int64)
    found = [times[i] for i in known.tolist()]
    first: Kind = "video" if rig.video is not None else "stereo"
    other: Kind = "stereo" if set(kinds.values()) == {"video"} and rig.has_stereo else first
    return Exposures(
        _between(indices, known, found),
        tuple(kinds.get(i, first if i in times else other) for i in indices.tolist()),
        np.isin(indices, known),
        frames,
    )


def _kind(methods: set[str], ran: set[str]) -> Kind | None:
    """Returns the kind of a measurement at which, of the methods that `ran`, exactly these stepped; None where several
    kinds are possible."""
    possible = frozenset.intersection(*(registered(method).sensors for method in methods))
    others = frozenset[Kind]().union(*(registered(m).sensors for m in ran - methods if m in names()))
    for kinds in (possible, possible - others):
        if len(kinds) == 1:
            return next(iter(kinds))
    return None


def _between(indices: NDArray[np.int64], known: NDArray[np.int64], times_ns: list[int]) -> NDArray[np.int64]:
    """Times of all indices, in integers: a float has too few digits for nanoseconds since 1970."""
    found = np.zeros(len(indices), np.int64)
    found[: known[0] + 1 if len(known) else 0] = times_ns[0] if times_ns else 0
    for (a, at), (b, bt) in pairwise(zip(known.tolist(), times_ns, strict=True)):
        found[a : b + 1] = [at + (bt - at) * (i - a) // (b - a) for i in range(a, b + 1)]
    return found


def records(
    folder: Path, of: Exposures, methods: Collection[str], placed: Iterable[Placed], start: Mapping[str, Similarity]
) -> Iterator[ExposureRecord]:
    """Yields every frame in order, with the steps of these methods. Raises InputError as `exposures`.

    `start` has the placements before the first frame. Values of other methods, which ran inside these, are included.
    """
    before: ExposureRecord | None = None
    with stored_steps(folder) as steps:
        groups = dict.fromkeys(range(len(of.kinds)), ())
        written = groupby(steps, attrgetter("exposure"))
        index, group = next(written, (len(groups), iter(())))
        for i in groups:
            rows: tuple[StoredStep, ...] = ()
            if index == i:
                rows = tuple(group)
                index, group = next(written, (len(groups), iter(())))
            before = _record(i, of, rows, methods, _placements(start, placed, i), before)
            yield before


def _record(
    index: int,
    of: Exposures,
    rows: tuple[StoredStep, ...],
    methods: Collection[str],
    placements: Mapping[str, Similarity],
    before: ExposureRecord | None,
) -> ExposureRecord:
    errors_m = {s.method: float(s.values["error_m"]) for s in rows if s.values["error_m"] is not None}  # type: ignore[arg-type]
    own = [s for s in rows if s.method in methods and of.kinds[index] in registered(s.method).sensors]
    steps = tuple(map(step_of, own))
    statuses = dict(before.statuses) if before is not None else {}
    statuses |= {step.method: MethodStatus.of(step, errors_m.get(step.method)) for step in steps}
    return ExposureRecord(
        index,
        int(of.times_ns[index]),
        of.kinds[index],
        steps,
        placements,
        {s.method: errors_m[s.method] for s in own if s.method in errors_m},
        statuses,
        stored={s.method: s.values for s in rows},
    )


def step_of(stored: StoredStep) -> Step:
    """Returns the step of a row, without tracks, points and residuals."""
    values = stored.values
    return Step(
        stored.time_ns,
        Status(str(values["status"])),
        stored.frame,
        _pose(values),
        key_frame=values["key_frame"] is True,
        scale=_number(values["scale"]),
        seconds=stored.seconds,
        decisions=stored.decisions,
        scale_sigma=_number(values["scale_sigma"]),
        method=stored.method,
        restarted=values["restarted"] is True,
        segment_age_ns=int(_number(values.get("segment_age_ns")) or 0),
        provisional=values["provisional"] is True,
    )


def _pose(values: Mapping[str, object]) -> Pose | None:
    """world_from_frame; None where the row has none."""
    numbers = [values.get(name) for name in POSE]
    if any(number is None for number in numbers):
        return None
    return Pose.from_xyzw(np.array(numbers[3:], float), np.array(numbers[:3], float))


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) else None


def _placements(start: Mapping[str, Similarity], placed: Iterable[Placed], index: int) -> Mapping[str, Similarity]:
    return {**start, **{method: found for at, method, found in placed if at <= index and method in start}}
