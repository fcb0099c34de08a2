"""A method's card: what it did at an exposure, in order, what it checked, and what came out; values, no HTML."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ispom.estimator import Method
from ispom.geometry import Similarity
from ispom.methods import method as registered
from ispom.types import Check, Decision, Step, Tracks, TrackStatus

from ... import colours
from ...decisions import SIGNS, answers, margin, mark, number, sentence
from ...run.history.quantities import DROPPED
from ...run.history.record import ExposureRecord
from ...run.model.drawn_size import unit_in_metres
from ...texts import length
from ...uncertainty import describe

TINTS = {
    "✓": "light-dark(#00795a, #2bb58d)",
    "✕": "light-dark(#c62828, #ff7b70)",
    "●": "light-dark(#0072b2, #56b4e9)",
    "!": "light-dark(#8a5a00, #f0b429)",
}
HINTS = {
    "✓": "required: passed",
    "✕": "required: failed",
    "●": "trigger: fired",
    "○": "trigger: did not fire",
    "·": "measurement: neither pass nor fail",
    "!": "measurement: doubtful, beyond its limit",
}
KEYS = {status: key for key, status in DROPPED.items()} | {TrackStatus.ALIVE: "alive", TrackStatus.NEW: "new"}
"""Under which key the tracks of a status are counted."""


@dataclass(frozen=True)
class Stage:
    """One of the steps that a method took, in order."""

    name: str
    ms: str
    text: str


@dataclass(frozen=True)
class CheckRow:
    quantity: str
    """METHOD.KEY: what plots, break points, tables and comparisons call it."""
    mark: str
    tint: str
    hint: str
    sentence: str
    compared: str
    margin: str


@dataclass(frozen=True)
class Group:
    """The checks behind one question."""

    question: str
    text: str
    checks: tuple[CheckRow, ...]


@dataclass(frozen=True)
class Fact:
    label: str
    text: str
    quantity: str = ""
    """METHOD.KEY where it can be plotted."""


@dataclass(frozen=True)
class Card:
    label: str
    colour: str
    status: str
    uses: str
    """The methods that it builds on."""
    stages: tuple[Stage, ...]
    groups: tuple[Group, ...]
    facts: tuple[Fact, ...]


def cards(record: ExposureRecord) -> list[Card]:
    """Of the methods that used the exposure, and of those that ran inside them alone."""
    asked = {step.method for step in record.steps}
    found: dict[str, Card] = {}
    for step in record.steps:
        found[step.method] = card(step, record)
        for part in step.parts:
            if part.method not in asked:
                found.setdefault(part.method, card(part, record))
    return list(found.values())


def card(step: Step, record: ExposureRecord) -> Card:
    own = registered(step.method)
    return Card(
        colours.label(step.method),
        colours.css(colours.of(step.method)),
        f"{step.status}{' · key frame' if step.key_frame else ''}{' · new world' if step.restarted else ''}",
        ", ".join(colours.label(part.method) for part in step.parts),
        tuple(_stages(step, own)),
        tuple(
            Group(a.question, a.text, tuple(_check(step.method, d, own.checks) for d in a.checks))
            for a in answers(step.decisions)
        ),
        tuple(_facts(step, record)),
    )


def _stages(step: Step, own: Method) -> Iterator[Stage]:
    """Its own; those of the methods that it asks are on their cards."""
    theirs = tuple(f"{part.method}: " for part in step.parts)
    for name, seconds in step.seconds.items():
        if not name.startswith(theirs):
            yield Stage(name, f"{1000 * seconds:.1f}", own.stages.get(name, ""))


def _check(method: str, decision: Decision, checks: Mapping[str, Check]) -> CheckRow:
    sign, unit = mark(decision), f" {decision.unit}" if decision.unit else ""
    relation = SIGNS.get(decision.relation, decision.relation)
    about = f" ({decision.about})" if decision.about else ""
    return CheckRow(
        f"{method}.{decision.key}",
        sign,
        TINTS.get(sign, "inherit"),
        f"{decision.name}{about}; {HINTS[sign]}",
        sentence(decision, checks.get(decision.key)),
        f"{number(decision.value)} {relation} {number(decision.threshold)}{unit}",
        margin(decision),
    )


def _facts(step: Step, record: ExposureRecord) -> Iterator[Fact]:
    name, unit_m = step.method, _unit_m(record, step)
    for camera, tracks in step.tracks.items():
        yield from _tracks(name, camera, tracks)
    if len(step.residuals_px):
        median, p95 = np.median(step.residuals_px), np.percentile(step.residuals_px, 95)
        text = f"median {median:.2f} px, 95 % below {p95:.2f} px, {len(step.residuals_px)} points"
        yield Fact("residual", text, f"{name}.residual_median_px")
    if text := describe(step, unit_m):
        yield Fact("pose", text, f"{name}.sigma_position")
    if (error := record.errors_m.get(name)) is not None:
        yield Fact("error", f"{length(error)} from the ground truth", f"{name}.error_m")
    if step.scale is not None:
        yield Fact("scale", f"{step.scale:.4g} {registered(name).scale}", f"{name}.scale")
    if step.scale_sigma is not None:
        text = f"± {100 * step.scale_sigma:.2g} % since the start (1 sigma)"
        yield Fact("scale drift", text, f"{name}.scale_sigma")
    if step.seconds:
        yield Fact("time", f"{1000 * sum(step.seconds.values()):.1f} ms", f"{name}.seconds")


def _tracks(method: str, camera: str, tracks: Tracks) -> Iterator[Fact]:
    """How many there were, came, went and why, and are there now: the sum is right."""
    ended = np.array([TrackStatus(s).dropped for s in tracks.status], bool)
    began = (tracks.status == TrackStatus.NEW) | (ended & np.isnan(tracks.uv_prev[:, 0]))
    before, new, dropped = int((~began).sum()), int(began.sum()), int(ended.sum())
    now = before + new - dropped
    yield Fact(camera, f"{before} tracks before + {new} new − {dropped} dropped = {now} now", f"{method}.alive")
    reasons = Counter(TrackStatus(s) for s in tracks.status[ended])
    for status, count in reasons.most_common():
        yield Fact("", f"− {count} {status.reason}", f"{method}.{KEYS[status]}")


def _unit_m(record: ExposureRecord, step: Step) -> float | None:
    return unit_in_metres(step.method, record.placements.get(step.method, Similarity()).scale)
