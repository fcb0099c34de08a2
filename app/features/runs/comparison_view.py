"""What the mode Compare shows of two runs: which is better in what, how sure that is, and where their paths part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from .compared_method import ComparedMethod, MethodRun, Metric
from .compared_paths import Curve, Place
from .stretches import Verdict, needed, tested

SIDES: tuple[Verdict, ...] = ("a", "b")
WHOLE: Mapping[Verdict, str] = {
    "a": "A is better.",
    "b": "B is better.",
    "same": "A and B are equally good.",
    "cannot tell": "Cannot tell which is better.",
}


@dataclass(frozen=True, eq=False)
class ComparedRun:
    """One side."""

    methods: Mapping[str, MethodRun]
    count: int
    """Frames computed."""
    events: int | None = None
    """That need attention; None where that is unknown."""


class ComparisonView(msgspec.Struct, frozen=True):
    better: Verdict
    """Over all methods that both have."""
    sentence: str
    frames: int
    """Number of frames that both runs have, from the first one on."""
    metrics: list[Metric]
    parting: Place | None
    """The earliest of all methods; None where all paths stay together."""
    curves: list[Curve]


def comparison_view(a: ComparedRun, b: ComparedRun, times_ns: NDArray[np.int64], start: int = 0) -> ComparisonView:
    """Compares two runs on the frames that both have. `times_ns` (N,) are the times of the frames of both; from frame
    `start` on they were computed separately."""
    count = min(a.count, b.count, len(times_ns))
    methods = [method for method in a.methods if method in b.methods]
    compared = [ComparedMethod(m, a.methods[m], b.methods[m], times_ns[:count], start) for m in methods]
    pairs = [pair for each in compared for pair in each.pairs()]
    found = iter(tested([each for each, _ in pairs], [margin for _, margin in pairs]))
    enough = needed([each for each, _ in pairs])
    for each in compared:
        each.judge([next(found) for _ in each.pairs()], enough)
    places = [place for each in compared if (place := each.paths.place())]
    better, sentence = _overall(compared, count)
    metrics = [metric for each in compared for metric in each.metrics()]
    events = ["" if run.events is None else str(run.events) for run in (a, b)]
    if any(events):
        metrics.append(Metric("events", "", "Losses and warnings", events[0], events[1], ""))
    return ComparisonView(
        better,
        sentence,
        count,
        metrics,
        min(places, key=lambda place: place.frame, default=None),
        [curve for each in compared if (curve := each.paths.curve())],
    )


def _overall(compared: Sequence[ComparedMethod], count: int) -> tuple[Verdict, str]:
    if not compared or not count:
        return "cannot tell", f"A and B have no {'frame' if compared else 'method'} in common."
    labels: dict[Verdict, list[str]] = {}
    for each in compared:
        labels.setdefault(each.better, []).append(each.label)
    named = {verdict: " and ".join(some) for verdict, some in labels.items()}
    sides: list[Verdict] = [side for side in SIDES if side in named]
    better: Verdict = sides[0] if len(sides) == 1 else "same" if list(named) == ["same"] else "cannot tell"
    if len(named) == 1:
        return better, WHOLE[better]
    parts = [f"{side.upper()} is better in {named[side]}" for side in sides]
    parts += [f"the same in {named['same']}"] if "same" in named else []
    parts += [f"cannot tell in {named['cannot tell']}"] if "cannot tell" in named else []
    text = "; ".join(parts) + "."
    return better, text[0].upper() + text[1:]
