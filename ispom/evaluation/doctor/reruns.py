"""Reruns of a method with one changed setting at a time.

A setting that differs from its default is set back to it, in the whole run if that is short. It is judged by the error
if there is ground truth, else by warnings and losses, checks and located frames. Other values are judged without any
truth.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ispom.errors import counted
from ispom.types import Status, Step

from .finding import Finding, Ranked, Suspect

LEAST_FRAMES, LEAST_SHARE = 2, 0.05
"""A setting helps where it changes at least this number of frames, and this share of them."""
WORSE, GOOD_PX = 2.0, 1.0
"""Residuals larger by this factor, and larger than this [px], show that a setting only accepts worse poses."""
BETTER = 1.5
"""The error falls noticeably by this factor: to two thirds."""
SHOWN_FRAMES = 4


@dataclass(frozen=True, eq=False)
class Outcome:
    """The result of a method over the stretch."""

    frames: int
    """Number of frames at which it stepped."""
    located: Mapping[int, float]
    """By index of each located frame: the median residual of its pose [px]; NaN where none is reported."""
    segments: int
    """Begun in the stretch."""
    failed: Mapping[str, int]
    """By key of a check: the number of frames in which it failed."""
    failing: int
    """Frames in which any failed."""
    alarms: Mapping[str, int] = field(default_factory=dict)
    """By kind: the number of warnings and losses that began."""
    error_m: float | None = None
    """The absolute trajectory error, aligned as in the metrics of a run; None without ground truth."""

    @staticmethod
    def of(steps: Iterable[tuple[int, Step]], alarms: Iterable[str] = (), error_m: float | None = None) -> Outcome:
        """Returns the outcome from the steps by index of their frames, and the kinds of warnings and losses that
        began."""
        own = tuple(steps)
        located = {
            i: float(np.median(step.residuals_px)) if len(step.residuals_px) else np.nan
            for i, step in own
            if step.status is Status.TRACKING and step.world_from_frame is not None and not step.provisional
        }
        failed = [{d.key or d.name for d in step.decisions if d.failed} for _, step in own]
        counts = Counter(key for keys in failed for key in keys)
        segments, failing = sum(step.restarted for _, step in own), sum(map(bool, failed))
        return Outcome(len(own), located, segments, dict(counts), failing, Counter(alarms), error_m)

    def __add__(self, later: Outcome) -> Outcome:
        """Returns that of both stretches."""
        failed = Counter(self.failed) + Counter(later.failed)
        located = {**self.located, **later.located}
        segments, failing = self.segments + later.segments, self.failing + later.failing
        return Outcome(self.frames + later.frames, located, segments, dict(failed), failing)

    @property
    def margin(self) -> float:
        """Frames by which another outcome differs noticeably."""
        return max(LEAST_FRAMES, LEAST_SHARE * self.frames)

    @property
    def improvable(self) -> bool:
        """Whether any setting could change it noticeably."""
        return self.segments > 0 or max(self.frames - len(self.located), self.failing) >= self.margin

    @property
    def words(self) -> str:
        """Returns the outcome as text in a row of a table."""
        begun = counted(self.segments, "segment")
        located = f"{len(self.located)} of {self.frames} frames located"
        error = "" if self.error_m is None else f", error {_length(self.error_m)}"
        return f"{located}{error}, {begun} begun, checks that failed: {self.failures}"

    @property
    def failures(self) -> str:
        """The checks that failed, and in how many frames."""
        return ", ".join(f"{key} in {count}" for key, count in sorted(self.failed.items())) or "none"


@dataclass(frozen=True)
class Trial:
    """One setting of a method with another value."""

    method: str
    name: str
    """Name of the setting in the config."""
    before: Any
    value: Any

    @property
    def key(self) -> str:
        """METHOD.SETTING, as in flags."""
        return f"{self.method}.{self.name.replace('_', '-')}"

    @property
    def option(self) -> str:
        """Returns the setting as an option of the command line."""
        flag = self.name.replace("_", "-")
        if isinstance(self.value, bool):
            return f"--{self.method}.{flag if self.value else f'no-{flag}'}"
        return f"--{self.key} {self.value:.6g}" if isinstance(self.value, float) else f"--{self.key} {self.value}"


@dataclass(frozen=True, eq=False)
class Tried:
    """A trial and its outcomes: with the images as they are; where that is better, also with a little noise on them."""

    trial: Trial
    outcomes: tuple[Outcome, ...]
    unchanged: tuple[Outcome, ...]
    """Outcomes with the run's own settings and the same images."""
    later: tuple[Outcome, Outcome] | None = None
    """Outcomes after the stretch, with the trial and with the run's own settings; None if they were not computed."""
    event: str = ""
    """The kind of warning or loss that is to be explained; empty where there is none."""

    @cached_property
    def gains(self) -> Mapping[str, float]:
        """Returns by how much its worst outcome is better than the best unchanged one, relative to the least gain that
        counts, by words for the kind of gain. Empty if it locates fewer frames, begins more segments, or only accepts
        worse poses.

        If the error is known, it decides: a few frames fewer are no loss then, and a larger error is one.
        """
        own, other = self.outcomes, self.unchanged
        longer = min(len(o.located) for o in own) - max(len(o.located) for o in other)
        cleaner = min(o.failing for o in other) - max(o.failing for o in own)
        joined = min(o.segments for o in other) - max(o.segments for o in own)
        first_map = all(o.segments == 0 for o in other) and max(o.segments for o in own) == 1
        margin = other[0].margin
        fall = self._fall
        if fall is not None and (fall >= BETTER or fall * BETTER <= 1):
            if longer <= -margin or fall < 1:
                return {}
            before_m, after_m = (_length(o[0].error_m or 0.0) for o in (other, own))
            return {f"the error falls from {before_m} to {after_m}": float(np.log(fall) / np.log(BETTER))}
        if longer < 0 or (joined < 0 and not first_map) or self._tolerated:
            return {}
        removed = min(o.alarms.get(self.event, 0) for o in other) if self._explained else 0
        return {
            f"the event ({self.event}) does not happen": float(removed),
            f"{counted(longer, 'frame')} more located ({margin:.2g} needed)": longer / margin,
            f"checks fail in {counted(cleaner, 'frame')} fewer ({margin:.2g} needed)": cleaner / margin,
            f"{counted(joined, 'segment')} fewer begun": float(joined),
        }

    @property
    def _fall(self) -> float | None:
        """The smallest error unchanged over the largest one with the setting; None where one of them is not known."""
        own, other = ([o.error_m for o in outcomes] for outcomes in (self.outcomes, self.unchanged))
        known = [[error for error in errors if error is not None] for errors in (own, other)]
        if len(known[0]) < len(own) or len(known[1]) < len(other):
            return None
        return min(known[1]) / max(*known[0], 1e-9)

    @property
    def _explained(self) -> bool:
        """Whether the event happens without the change only."""
        own, other = ([o.alarms.get(self.event, 0) for o in outcomes] for outcomes in (self.outcomes, self.unchanged))
        return bool(self.event) and not any(own) and all(other)

    @property
    def only_delays(self) -> bool:
        """Returns whether the gain in the stretch is lost again after it."""
        if self.later is None:
            return False
        own, other = self.outcomes[0] + self.later[0], self.unchanged[0] + self.later[1]
        return not Tried(self.trial, (own,), (other,)).helps

    @property
    def strength(self) -> float:
        """Returns the strength of the trial; it helps from 1 on."""
        return max(0.0, *self.gains.values()) if self.gains and not self.only_delays else 0.0

    @property
    def gain(self) -> str:
        """Returns the largest gain in words; empty without one."""
        return max(self.gains, key=lambda words: self.gains[words], default="")

    @property
    def _tolerated(self) -> bool:
        """Whether residuals at the frames that both locate say that it only accepts worse poses."""
        for own, other in zip(self.outcomes, self.unchanged, strict=False):
            common = [i for i in own.located if i in other.located]
            pair = [np.array([o.located[i] for i in common]) for o in (own, other)]
            known = np.isfinite(pair).all(axis=0)
            if known.any():
                mine, theirs = (float(np.median(residuals[known])) for residuals in pair)
                if mine > max(WORSE * theirs, GOOD_PX):
                    return True
        return False

    @property
    def helps(self) -> bool:
        return self.strength >= 1

    @property
    def finding(self) -> Finding:
        own, other, count = self.outcomes, self.unchanged, len(self.outcomes)
        newly = [i for i in own[0].located if i not in other[0].located]
        evidence = (
            f"With {self.trial.option}: {own[0].words}; unchanged ({_text(self.trial.before)}): {other[0].words}."
        )
        if self.helps:
            repeated = f"so it is in the worst of {count} reruns, {count - 1} of them with noise on the images"
            evidence = f"With {self.trial.option}, {self.gain}; {repeated}. {evidence}"
        errors = {"error_m": own[0].error_m, "error_unchanged_m": other[0].error_m}
        if self.only_delays:
            evidence += " It only delays the trouble: in the frames after the stretch that is lost again."
        return Finding(
            self.strength,
            evidence,
            {
                "located": min(len(o.located) for o in own),
                "located_unchanged": max(len(o.located) for o in other),
                "failing": max(o.failing for o in own),
                "failing_unchanged": min(o.failing for o in other),
                "segments": max(o.segments for o in own),
                "segments_unchanged": max(o.segments for o in other),
                **{name: error for name, error in errors.items() if error is not None},
            },
            tuple(newly[:: len(newly) // SHOWN_FRAMES + 1]),
        )


@dataclass(frozen=True, eq=False)
class Reruns:
    """All reruns of a stretch."""

    first: int
    last: int
    """Frames of the stretch, both included; the fork is before the first."""
    tried: tuple[Tried, ...] = ()
    left: tuple[str, ...] = ()
    """Options for which no time was left."""
    note: str = ""
    """Why nothing was tried, or a caution about the trials."""
    set_back: bool = False
    """Whether settings that differ from their defaults were set back to them."""

    @property
    def best(self) -> Tried | None:
        """Returns the trial that helps most; None if none does."""
        return max((t for t in self.tried if t.helps), key=lambda t: t.strength, default=None)

    @property
    def answer(self) -> str:
        """One or two sentences."""
        if not self.tried:
            return self.note
        best = self.best
        text = "No setting tried changes it."
        if best is not None:
            text = f"It goes better with {best.trial.option}: {best.gain}."
        return f"{text} {self.note}".rstrip()

    @property
    def ranked(self) -> tuple[Ranked, ...]:
        """Each setting with the value that does best, as a suspect."""
        best: dict[str, Tried] = {}
        for tried in self.tried:
            known = best.get(tried.trial.key)
            if known is None or tried.strength > known.strength:
                best[tried.trial.key] = tried
        return tuple(Ranked(self._suspect(tried.trial, tried.finding), tried.finding) for tried in best.values())

    def _suspect(self, trial: Trial, finding: Finding) -> Suspect:
        name = f"the setting {trial.key} is {_text(trial.before)}"
        fork = f", or fork the run: `ispom fork RUN --at {self.first} {trial.option}`" if self.first > 0 else ""
        remedy = f"Run again with `{trial.option}`{fork}."
        return Suspect(trial.key, name, "setting" if self.set_back else "rerun", remedy, lambda seen: finding)


def _text(value: Any) -> str:
    return {True: "on", False: "off"}[value] if isinstance(value, bool) else str(value)


def _length(metres: float) -> str:
    return f"{metres:.3g} m" if metres >= 1 else f"{1000 * metres:.3g} mm"
