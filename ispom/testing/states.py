"""Checks that a State is a value: it can be kept, copied and stepped from twice, and has bounded size."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Iterator
from dataclasses import is_dataclass, replace
from itertools import count, islice
from typing import Any

import cv2

from ispom.testing.trial import Numbered, Trial, Walk, failing_as, walked
from ispom.testing.values import TIMES, depth, digest
from ispom.types import ImuSamples, Measurement, WheelIncrement, images_of

MAX_DEPTH = 60
"""Largest depth of nested values in a State, after a run of any length."""
STANDING = 60
"""Frames of each kind during which the platform is at rest, to measure the growth of a State."""
GROWTH = 0.2
"""Largest growth of a State per frame, as a share of the frame's bytes. A pose takes less than a kB."""
OTHER_THREADS = 2


def check_values(trial: Trial, walk: Walk) -> None:
    """Checks that States are frozen, of bounded depth, and the same after copying, pickling and printing."""
    places = ["the start", *(numbered.place for numbered in trial.frames)]
    for i in (0, len(walk.steps) // 2, len(walk.steps)):
        state, place = walk.states[i][trial.method.name], places[i]
        frozen = is_dataclass(state) and type(state).__dataclass_params__.frozen  # type: ignore[attr-defined]
        trial.require(frozen, f"has a State that is no frozen dataclass ({type(state).__name__})", place)
        _require_shallow(trial, state, place)
        with failing_as(trial.method, "has a State that cannot be copied, pickled and printed", place):
            copies = [copy.deepcopy(state), pickle.loads(pickle.dumps(state))]  # noqa: S301 (made in this line)
            repr(state)
        whole = digest(state)
        trial.require(all(digest(c) == whole for c in copies), "has a State whose copy is not the same", place)


def check_finish(trial: Trial, walk: Walk) -> None:
    """Checks that `finish` can be called at any frame and does not change later results."""
    built, seen = walk.built, dict[int, str]()
    frames = {step.frame for step in walk.steps}
    for i in range(len(walk.steps) + 1):
        place = trial.frames[i - 1].place if i else "the start"
        if i:
            seen[walk.steps[i - 1].time_ns] = place
        trajectory = built.finish(walk.states[i], place)
        times = trajectory.times_ns.tolist()
        trial.require(times == sorted(set(times)), "finishes with times that do not increase", place)
        trial.require(set(times) <= seen.keys(), "finishes with poses at times of no frame", place)
        trial.require(
            not times or trajectory.frame in frames, f"finishes with poses of the frame {trajectory.frame}", place
        )
    trial.require(len(trajectory), "finishes without any pose")
    again = built.finish(walk.states[-1], "the end")
    trial.require(digest(again) == digest(trajectory), "finishes differently when called twice")


def check_repeats(trial: Trial, walk: Walk) -> None:
    """Checks for the same bits from new estimators, with other numbers of threads, and from earlier States."""
    threads = cv2.getNumThreads()
    try:
        cv2.setNumThreads(OTHER_THREADS if threads != OTHER_THREADS else 1)
        again = walked(trial.build(), trial.frames)
    finally:
        cv2.setNumThreads(threads)
    _require_same(trial, walk, again, 0, "gives something else in another run")
    middle = len(walk.steps) // 2
    ahead = trial.frames[middle:]
    for i in range(0, len(walk.steps), max(1, len(walk.steps) // 4)):
        once = walked(walk.built, trial.frames[i : i + 1], walk.states[i])
        _require_same(trial, walk, once, i, "gives something else when it is stepped twice from one State")
    later = walked(walk.built, ahead, walk.states[middle])
    _require_same(trial, walk, later, middle, "gives something else when it goes on from an earlier State")
    stored = {name: pickle.loads(pickle.dumps(state)) for name, state in walk.states[middle].items()}  # noqa: S301
    rebuilt = walked(trial.build(), ahead, stored)
    _require_same(trial, walk, rebuilt, middle, "gives something else when it is built again and goes on from a State")


def check_bounded(trial: Trial, walk: Walk) -> None:
    """Checks that a State grows by little more than poses."""
    built, state, sizes, total = walk.built, walk.states[-1], list[int](), 0
    for numbered in standing(trial):
        state, _ = built.step(state, numbered)
        sizes.append(_size(state[trial.method.name]))
        total += _bytes(numbered.frame)
    _require_shallow(trial, state[trial.method.name], "the end")
    half = len(sizes) // 2
    grown = (max(sizes[half:]) - max(sizes[:half])) / half
    most = GROWTH * total / len(sizes)
    problem = f"has a State that grows by {grown:.0f} bytes per frame, more than {most:.0f}"
    trial.require(grown <= most, f"{problem}, while nothing moves after the last frame")


def check_unchanged(trial: Trial, walk: Walk) -> None:
    """Checks that no State of the run was changed since it was made."""
    for i, (state, before) in enumerate(zip(walk.states, walk.digests, strict=True)):
        place = trial.frames[i - 1].place if i else "the start"
        trial.require(digest(state) == before, "changes a State that was kept from before", place)


def standing(trial: Trial) -> Iterator[Numbered]:
    """Yields more frames after the last one, with the same images."""
    last = {numbered.frame.kind: numbered for numbered in trial.frames}
    end_ns = max(numbered.frame.time_ns for numbered in trial.frames)
    moments = (end_ns + 33_000_000 * k for k in count(1))
    for moment_ns in islice(moments, STANDING):
        for kind, numbered in last.items():
            time_ns = moment_ns + (11_000_000 if kind == "stereo" else 0)
            yield numbered.like(at(numbered.frame, time_ns), "again, at rest")


def at(frame: Measurement, time_ns: int) -> Measurement:
    """Returns the same measurement at another time."""
    later_ns = time_ns - frame.time_ns
    if isinstance(frame, ImuSamples):
        return replace(frame, time_ns=time_ns, times_ns=frame.times_ns + later_ns)
    if isinstance(frame, WheelIncrement):
        return replace(frame, time_ns=time_ns, since_ns=frame.since_ns + later_ns)
    return replace(frame, time_ns=time_ns)


def _require_same(trial: Trial, walk: Walk, again: Walk, first: int, what: str) -> None:
    """Checks that Steps and States of `again` are those of `walk` from frame `first` on."""
    for k, step in enumerate(again.steps):
        place = trial.frames[first + k].place
        trial.require(digest(walk.steps[first + k], TIMES) == digest(step, TIMES), f"{what}: another Step", place)
        trial.require(walk.digests[first + k + 1] == again.digests[k + 1], f"{what}: another State", place)


def _require_shallow(trial: Trial, state: Any, place: str) -> None:
    level = depth(state)
    trial.require(level <= MAX_DEPTH, f"has a State nested {level} deep, more than {MAX_DEPTH}", place)


def _size(state: Any) -> int:
    return len(pickle.dumps(state))


def _bytes(measurement: Measurement) -> int:
    return sum(image.nbytes for image in images_of(measurement).values())
