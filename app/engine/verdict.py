"""A verdict: one sentence about a method at a frame, with a severity, from what its step decided and measured."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum

from ispom.methods import method as registered
from ispom.types import Check, Decision, Status, Step

from ..presentation import colours
from ..presentation.decisions import number, sentence
from .history.quantity import Value

HEADLINE = re.compile(r"([A-Z][^:.;()\d]{2,29}): (?=.)")
"""The headline with which a check's sentence may begin: "Scale unreliable: ..."."""
FIRST = "collecting frames"
"""Detail of a verdict without a map, at a frame without checks."""
WARNING = "Warning"
"""The headline of a failed check whose sentence has none."""
WAITING = "Waiting"
"""The headline of a method before its first step."""


class Severity(StrEnum):
    """How a method is doing, from good to bad."""

    OK = "ok"
    KEYFRAME = "keyframe"
    PROVISIONAL = "provisional"
    """There is no map or fit yet: the pose is a guess or missing."""
    WARNING = "warning"
    LOST = "lost"

    @property
    def alarming(self) -> bool:
        return self in (Severity.WARNING, Severity.LOST)


@dataclass(frozen=True)
class Verdict:
    method: str
    frame: int
    """The frame of the method's step, which may be before the frame that is shown."""
    severity: Severity
    headline: str
    """Two or three words: "Tracking", "Scale unreliable"."""
    detail: str
    """The numbers and the reason, without a full stop at the end; empty where nothing is known."""
    decisive: Decision | None = None
    """The check that decided the verdict; None where the status alone did."""
    failed: tuple[Decision, ...] = ()
    """The checks that failed, the most severe first."""

    @property
    def sentence(self) -> str:
        return f"{self.headline}: {self.detail}." if self.detail else f"{self.headline}."


def verdict(step: Step, frame: int, values: Mapping[str, Value]) -> Verdict:
    """Returns the verdict on a method's step. `values` are the step's quantities by key, which a stored run has even
    without tracks."""
    checks = registered(step.method).checks
    failed = sorted(filter(alarming, step.decisions), key=_rank(checks))
    made = _Made(step, frame, checks, tuple(failed))
    if step.status == Status.LOST:
        return _lost(made)
    warnings = [d for d in failed if d.kind == "warning" or step.status == Status.TRACKING]
    if warnings:
        headline, detail = made.words(warnings[0], WARNING)
        return made.verdict(Severity.WARNING, headline, detail, warnings[0])
    if step.provisional:
        unit = made.last("scale", passed=False)
        why = "waiting for the first stereo pairs" if unit is None else made.words(unit, "")[1]
        return made.verdict(Severity.PROVISIONAL, "Provisional pose", why, unit)
    return _initialising(made) if step.status == Status.INITIALISING else _tracking(made, values)


def missing(step: Step) -> str:
    """Returns what a step without a pose waits for, by the check that failed; empty where no check failed."""
    found = verdict(step, 0, {})
    if found.decisive is not None:
        return found.sentence
    made = _Made(step, 0, registered(step.method).checks, ())
    finding = next((d for d in reversed(step.decisions) if d.kind == "finding" and not d.passed), None)
    return "" if finding is None else made.sentence(finding)


def alarming(decision: Decision) -> bool:
    """Whether a check failed that a person should know of: a requirement or a warning, never a trigger or a finding."""
    return decision.failed or (decision.kind == "warning" and not decision.passed)


@dataclass(frozen=True)
class _Made:
    """The data that all verdicts on one step share."""

    step: Step
    frame: int
    checks: Mapping[str, Check]
    failed: tuple[Decision, ...]

    def verdict(self, severity: Severity, headline: str, detail: str, decisive: Decision | None = None) -> Verdict:
        return Verdict(self.step.method, self.frame, severity, headline, detail, decisive, self.failed)

    def last(self, topic: str, *, passed: bool) -> Decision | None:
        """The last check about a topic that had this outcome."""
        about = (d for d in reversed(self.step.decisions) if self.topic(d) == topic)
        return next((d for d in about if d.passed == passed), None)

    def topic(self, decision: Decision) -> str:
        check = self.checks.get(decision.key)
        return "" if check is None else check.topic

    def sentence(self, decision: Decision) -> str:
        return sentence(decision, self.checks.get(decision.key))

    def words(self, decision: Decision, headline: str) -> tuple[str, str]:
        """The headline of a check's sentence, or else the one given; and the rest, without its full stop."""
        check, text = self.checks.get(decision.key), self.sentence(decision).removesuffix(".")
        own = HEADLINE.match(text) if check is not None and check.passes else None
        if own is not None:
            return own[1], text[own.end() :]
        return headline, text[:1].lower() + text[1:] if re.match(r"[A-Z][a-z]", text) else text


def _lost(made: _Made) -> Verdict:
    requirements = [d for d in made.step.decisions if d.failed]
    decisive = made.last("pose", passed=False) or (requirements[-1] if requirements else None)
    detail = "" if decisive is None else made.words(decisive, "")[1]
    followed = next(
        (d.consequence for d in made.step.decisions if d.consequence and d is not decisive and d.failed), ""
    )
    detail = f"{detail}; {followed}" if detail and followed else detail or "there is no pose at this frame"
    return made.verdict(Severity.LOST, "Lost", detail, decisive)


def _initialising(made: _Made) -> Verdict:
    decisive = made.last("map", passed=False) or next((d for d in reversed(made.failed) if d.failed), None)
    if decisive is None:
        dependencies = [colours.label(name) for name in registered(made.step.method).asks.values()]
        headline, detail = (
            ("No pose yet", f"waiting for {' and '.join(dependencies)}") if dependencies else ("No map yet", FIRST)
        )
        return made.verdict(Severity.PROVISIONAL, headline, detail)
    headline, detail = made.words(decisive, "No map yet")
    return made.verdict(Severity.PROVISIONAL, headline, detail, decisive)


def _tracking(made: _Made, values: Mapping[str, Value]) -> Verdict:
    decisive, severity = made.last("pose", passed=True), Severity.KEYFRAME if made.step.key_frame else Severity.OK
    if decisive is None and (mapped := made.last("map", passed=True)) is not None:
        return made.verdict(severity, "Map initialised", points(values), mapped)
    headline, detail = ("Tracking", _measured(values)) if decisive is None else made.words(decisive, "Tracking")
    reason = next((d for d in made.step.decisions if d.kind == "trigger" and d.passed and made.topic(d) == ""), None)
    if made.step.key_frame and reason is not None:
        why = made.sentence(reason).removesuffix(".")
        detail = f"{detail}. {why}" if detail else why
    return made.verdict(severity, headline, detail, decisive)


def points(values: Mapping[str, Value]) -> str:
    """The number of points of a map: "214 points"; empty where it is not known."""
    count = values.get("landmarks") or values.get("inliers")
    return f"{count:.0f} points" if isinstance(count, int | float) else ""


def pose_detail(step: Step, values: Mapping[str, Value]) -> str:
    """Returns how a tracked pose was found, such as "345 matches (minimum 120)", whatever the step warns of."""
    made = _Made(step, 0, registered(step.method).checks, ())
    decisive = made.last("pose", passed=True)
    return _measured(values) if decisive is None else made.words(decisive, "")[1]


def _measured(values: Mapping[str, Value]) -> str:
    """Returns how well the pose fits if no check says it, such as "412 inliers, median residual 0.21 px"."""
    inliers, residual = values.get("inliers"), values.get("residual_median_px")
    parts = [f"{inliers:.0f} inliers"] if isinstance(inliers, int | float) else []
    parts += [f"median residual {number(residual)} px"] if isinstance(residual, int | float) else []
    return ", ".join(parts)


def _rank(checks: Mapping[str, Check]):
    """Orders failed checks: requirements first, then those about a topic, then by how far each is beyond its limit."""

    def rank(decision: Decision) -> tuple[bool, bool, float]:
        check = checks.get(decision.key)
        beyond = abs(decision.margin) / max(abs(decision.threshold), 1e-12)
        return not decision.failed, check is None or not check.topic, -beyond

    return rank


def waiting(method: str, camera: str) -> Verdict:
    """Returns the verdict on a method that has not stepped yet."""
    return Verdict(method, -1, Severity.PROVISIONAL, WAITING, f"no {camera} frame so far")


def worst(verdicts: Iterable[Verdict]) -> Severity:
    """The most severe of them; OK where there is none."""
    order = list(Severity)
    return max((v.severity for v in verdicts), key=order.index, default=Severity.OK)
