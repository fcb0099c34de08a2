"""One method in two runs: its errors, shares and paths side by side, and the verdict on them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from ispom.errors import counted
from ispom.evaluation.trajectory_error import TrajectoryError

from ...engine.differences.paths import Path
from ...presentation import colours
from ...presentation.texts import ALIGNED, computing_time, length, length_unit
from .compared_paths import ComparedPaths
from .stretches import EFFECT, LOCATED, Pairs, Tested, Verdict, error_pairs, share_pairs

SAME_TRUTH_M = 1e-6


@dataclass(frozen=True, eq=False)
class MethodRun:
    """What one method did in one run."""

    path: Path
    """As each pose was given at its frame."""
    frames: NDArray[np.int64]
    """(N,) those at which it stepped."""
    localised: NDArray[np.bool_]
    """(N,)"""
    error: TrajectoryError | None = None
    """Against the ground truth, as known at the end; None without one."""
    seconds: float | None = None
    """Median computing time of a frame."""


class Metric(msgspec.Struct, frozen=True):
    """One quantity in both runs."""

    key: Literal["ate", "located", "seconds", "events"]
    of: str
    """The name of the method; empty: of the whole run."""
    label: str
    a: str
    b: str
    """As people read them; empty where it is unknown."""
    better: Verdict | Literal[""]
    """Empty: no verdict is possible of a quantity like this."""
    why: str = ""
    """In a sentence: how sure that is, and by what."""
    mostly: tuple[int, int] | None = None
    """First and last frame of the stretch in which more than two thirds of the difference arise."""


class ComparedMethod:
    """One method in both runs."""

    def __init__(self, method: str, a: MethodRun, b: MethodRun, times_ns: NDArray[np.int64], start: int) -> None:
        self.method, self.times_ns = method, times_ns
        self.a, self.b = _until(a, len(times_ns)), _until(b, len(times_ns))
        self.label = colours.label(method)
        self.start = start
        self.paths = ComparedPaths(method, self.a.path, self.b.path, a.error, times_ns)
        self.errors, self.why_not = _comparable(a.error, b.error, times_ns)
        both = np.intersect1d(self.a.frames, self.b.frames)
        both = both[both >= start]
        shares = [run.localised[np.isin(run.frames, both)] for run in (self.a, self.b)]
        self._located = share_pairs(both, shares[0], shares[1])
        self._errors = self._error_pairs()
        self._tests, self._needed = tuple[Tested, ...](), 0

    def pairs(self) -> list[tuple[Pairs, float]]:
        """What is to be tested, each with its margin: the share of localised frames, and errors where there are any."""
        return [(self._located, LOCATED), *([] if self._errors is None else [(self._errors, EFFECT)])]

    def judge(self, tests: Sequence[Tested], needed: int) -> None:
        """Takes what `pairs` gave, before anything else is asked for; `needed` stretches can show anything."""
        self._tests, self._needed = tuple(tests), needed

    def _error_pairs(self) -> Pairs | None:
        if self.errors is None:
            return None
        stepped = np.union1d(self.a.frames, self.b.frames)
        stepped = stepped[stepped >= self.start]
        found = error_pairs(*self.errors, self.times_ns[stepped])
        of = [(int(stepped[i]), int(stepped[j])) for i, j in found.stretches]
        most = found.dominant
        return Pairs(tuple(of), found.values, most and (int(stepped[most[0]]), int(stepped[most[1]]), most[2]))

    @property
    def ates(self) -> tuple[float, float] | None:
        """Of both over the frames at which both have a pose [m]."""
        return None if self.errors is None else (self.errors[0].ate_m, self.errors[1].ate_m)

    @property
    def accuracy(self) -> Verdict:
        """Better is who drifts less from stretch to stretch, where the whole path does not say otherwise."""
        if self._errors is None or self.ates is None:
            return "cannot tell"
        found = self._tests[1].verdict
        return "cannot tell" if found in ("a", "b") and found != _smaller(*self.ates) else found

    @property
    def located(self) -> Verdict:
        return self._tests[0].verdict

    @property
    def shares(self) -> tuple[float, float]:
        """Of the frames at which each stepped, those at which it was localised."""
        a, b = (float(run.localised.mean()) if len(run.localised) else math.nan for run in (self.a, self.b))
        return a, b

    @property
    def better(self) -> Verdict:
        """As a line of `ispom gate`: better in one, and not worse in the other."""
        found = [self.accuracy, self.located]
        for side in ("a", "b"):
            if side in found:
                other = found[1 - found.index(side)]
                known = other in (side, "same") or (other == "cannot tell" and self._no_worse(side, found.index(side)))
                return side if known else "cannot tell"
        return "same" if found == ["same", "same"] else "cannot tell"

    def _no_worse(self, side: str, judged: int) -> bool:
        """Whether a quantity that the stretches do not decide is on the same side on these frames."""
        if judged == 0:
            a, b = self.shares
            return a >= b - LOCATED / 100 if side == "a" else b >= a - LOCATED / 100
        return self.ates is not None and _smaller(*self.ates) in (side, "same")

    def metrics(self) -> Iterator[Metric]:
        """The error, the share of localised frames, and the time per frame."""
        how = "" if self.errors is None else f", {ALIGNED[self.errors[0].alignment]}"
        unit = length_unit(self.ates or ())
        texts = ["" if self.ates is None else length(metres, unit) for metres in self.ates or (0.0, 0.0)]
        yield Metric("ate", self.label, f"ATE{how}", texts[0], texts[1], self.accuracy, self._why(), self._mostly)
        texts = ["" if math.isnan(share) else f"{100 * share:.3g} %" for share in self.shares]
        yield Metric("located", self.label, "Localised", texts[0], texts[1], self.located)
        seconds = [run.seconds for run in (self.a, self.b)]
        if any(each is not None for each in seconds):
            texts = ["" if each is None else computing_time(each) for each in seconds]
            yield Metric("seconds", self.label, "Time per frame", texts[0], texts[1], "")

    @property
    def _mostly(self) -> tuple[int, int] | None:
        dominant = None if self._errors is None else self._errors.dominant
        return None if dominant is None else dominant[:2]

    def _why(self) -> str:
        """Why the error has the verdict that it has."""
        if self.ates is None or self._errors is None:
            return f"Cannot tell: {self.why_not}."
        found, verdict = self._tests[1], self.accuracy
        if len(self._errors.values) and not self._errors.values.any() and self.ates[0] == self.ates[1]:
            return "The same."
        if found.change is None:
            drift = f"{counted(found.stretches, 'independent stretch', 'independent stretches')}, {self._needed} needed"
        else:
            drift = _drift(found)
        closer = "B" if self.ates[1] < self.ates[0] else "A"
        if verdict in ("a", "b"):
            text = f"{drift}."
        elif verdict == "same":
            text = f"The same within 1 %: {drift}."
        elif found.verdict in ("a", "b"):
            text = f"Cannot tell: {closer} is closer as a whole, but not from stretch to stretch: {drift}."
        else:
            text = f"Cannot tell: {closer} is closer on these frames, but that may be chance: {drift}."
        if self._errors.dominant is not None and verdict != "same":
            first, last, share = self._errors.dominant
            text += f" {100 * share:.0f} % of the difference arise in frames {first} to {last}."
        return text


def _until(run: MethodRun, count: int) -> MethodRun:
    """Its first frames."""
    kept, posed = run.frames < count, run.path.frames < count
    path = Path(run.path.frames[posed], run.path.xyz[posed], run.path.xyzw[posed])
    return MethodRun(path, run.frames[kept], run.localised[kept], run.error, run.seconds)


def _comparable(
    a: TrajectoryError | None, b: TrajectoryError | None, times_ns: NDArray[np.int64]
) -> tuple[tuple[TrajectoryError, TrajectoryError] | None, str]:
    """The errors over the frames at which both have a pose, or else why they cannot be compared."""
    if a is None or b is None:
        missing = "there is no ground truth" if a is None and b is None else f"{'A' if a is None else 'B'} has none"
        return None, missing if a is None and b is None else f"{missing} or too few poses with a ground truth"
    common = np.intersect1d(np.intersect1d(a.estimate.times_ns, b.estimate.times_ns), times_ns)
    over = a.over(common), b.over(common)
    if over[0] is None or over[1] is None:
        return None, "too few frames have a pose and a ground truth in both"
    away = np.abs(over[0].reference.translations - over[1].reference.translations).max()
    if away > SAME_TRUTH_M or over[0].alignment != over[1].alignment:
        return None, "their errors are measured against different ground truths"
    return (over[0], over[1]), ""


def _drift(found: Tested) -> str:
    """How many times as much the worse run drifts, with the bounds."""
    assert found.change is not None
    logs, more, less = [found.change.estimate, found.change.low, found.change.high], "B", "A"
    better = found.smaller_in_b
    if found.change.estimate < 0:
        logs, more, less = [None if log is None else -log for log in (logs[0], logs[2], logs[1])], less, more
        better = found.stretches - better
    factor, low, high = map(_factor, logs)
    of = f"less in {better} of {counted(found.stretches, 'stretch', 'stretches')}"
    return f"{more} drifts {factor} times as much as {less} ({low} to {high}; {of})"


def _smaller(a: float, b: float) -> Verdict:
    return "same" if a == b else "a" if a < b else "b"


def _factor(log_ratio: float | None) -> str:
    if log_ratio is None:
        return "?"
    value = math.exp(min(log_ratio, 20.0))
    return (
        "over 1000"
        if value > 1000
        else "below 0.001"
        if value < 0.001
        else f"{value:.2g}"
        if value < 100
        else f"{value:.0f}"
    )
