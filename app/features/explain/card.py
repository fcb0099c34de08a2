"""A method's card: its verdict, the checks that failed, and all that it did at the frame; values, no HTML."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import msgspec
import numpy as np

from ispom.estimator import Method
from ispom.geometry import Similarity
from ispom.methods import method as registered
from ispom.types import Check, Decision, Step, Tracks, TrackStatus

from ...engine.error_curve import ErrorCurve
from ...engine.frame_record import ERROR, INLIERS, LIVE_ERROR, RESIDUAL, FrameRecord
from ...engine.history.record import ExposureRecord
from ...engine.history.step_quantities.step import DROPPED
from ...engine.model.drawn_size import unit_in_metres
from ...engine.verdict import Severity, Verdict, verdict, waiting
from ...presentation import colours
from ...presentation.decisions import answers, mark, measured, sentence
from ...presentation.texts import PROVISIONAL, computing_time, length
from ...presentation.uncertainty import describe

HINTS = {
    "✓": "requirement: passed",
    "✕": "requirement: failed",
    "●": "trigger: fired",
    "○": "trigger: did not fire",
    "·": "measurement: neither good nor bad",
    "!": "warning: beyond its limit",
}
TINTS = {"✓": "good", "✕": "lost", "●": "keyframe", "!": "warning"}
KEYS = {status: key for key, status in DROPPED.items()} | {TrackStatus.ALIVE: "alive", TrackStatus.NEW: "new"}
"""Under which key the tracks of a status are counted."""
TAGS = {
    Severity.OK: "",
    Severity.KEYFRAME: "keyframe",
    Severity.PROVISIONAL: "initialising",
    Severity.WARNING: "warning",
    Severity.LOST: "lost",
}
CROWD = 6
"""Least number of insignificant measurements behind one question that share a line."""


class Stage(msgspec.Struct, frozen=True):
    """One of the steps that a method took, in order."""

    name: str
    ms: str
    text: str


class CheckRow(msgspec.Struct, frozen=True):
    quantity: str
    """METHOD.KEY: what plots, break points, tables and comparisons call it."""
    mark: str
    tint: str
    hint: str
    sentence: str
    numbers: str
    """The value, and the side of the threshold that is good; empty where the sentence states both."""
    name: str


class Group(msgspec.Struct, frozen=True):
    """The checks behind one question."""

    question: str
    text: str
    checks: tuple[CheckRow, ...]
    crowd: tuple[CheckRow, ...] = ()
    """Measurements that are not significant, of many."""


class Fact(msgspec.Struct, frozen=True):
    label: str
    text: str
    quantity: str = ""
    """METHOD.KEY where it can be plotted."""


class Details(msgspec.Struct, frozen=True):
    """What a method did at a frame, in order."""

    uses: str
    """The methods that it builds on."""
    stages: tuple[Stage, ...]
    groups: tuple[Group, ...]
    facts: tuple[Fact, ...]


@dataclass(frozen=True)
class Card:
    label: str
    colour: str
    verdict: Verdict
    tag: str
    """The words in the corner: "warning · keyframe"."""
    when: str
    """The frame of the verdict, where it is not the frame shown."""
    decisive: CheckRow | None
    """The failed check that decided the verdict, which says it in its words."""
    failed: tuple[CheckRow, ...]
    """The other failed checks, the most severe first."""
    details: Details | None
    """None of a method that did not step at the frame shown."""


def cards(
    record: ExposureRecord,
    methods: Iterable[str] = (),
    latest: Mapping[str, ExposureRecord] | None = None,
    curves: Mapping[str, ErrorCurve] | None = None,
) -> list[Card]:
    """Of the methods of a run, and of those that ran inside them alone; where one did not step on this frame, of its
    step in `latest`. `curves` has their position errors."""
    curves = curves or {}
    found = {step.method: _card(step, record, record.index, curves.get(step.method)) for step in _own(record)}
    for name in methods:
        earlier = (latest or {}).get(name)
        step = None if earlier is None else next((s for s in _own(earlier) if s.method == name), None)
        if name in found:
            continue
        if earlier is not None and step is not None:
            found[name] = _card(step, earlier, record.index)
        else:
            needs = " or ".join(sorted(registered(name).sensors))
            found[name] = Card(colours.label(name), _css(name), waiting(name, needs), "waiting", "", None, (), None)
    order = {name: place for place, name in enumerate(methods)}
    return sorted(found.values(), key=lambda card: order.get(card.verdict.method, len(order)))


def _own(record: ExposureRecord) -> list[Step]:
    """Each method's step once, the parts of a step after it: a part that is a step of its own as well is that step."""
    stepped_methods = {step.method for step in record.steps}
    found: dict[str, Step] = {}
    for step in record.steps:
        found[step.method] = step
        for part in step.parts:
            if part.method not in stepped_methods:
                found.setdefault(part.method, part)
    return list(found.values())


def _css(method: str) -> str:
    return colours.css(colours.of(method))


def _card(step: Step, record: ExposureRecord, shown: int, curve: ErrorCurve | None = None) -> Card:
    own = registered(step.method)
    here = FrameRecord(step.method, record, curve)
    found = verdict(step, record.index, here.values)
    rows = [_check(step.method, d, own.checks) for d in found.failed]
    others = tuple(row for d, row in zip(found.failed, rows, strict=True) if d is not found.decisive)
    failed = found.decisive if found.decisive in found.failed else None
    return Card(
        colours.label(step.method),
        _css(step.method),
        found,
        _tag(step, found.severity),
        "" if record.index == shown else f"at frame {record.index}",
        None if failed is None else _check(step.method, failed, own.checks),
        others,
        details(step, record, here) if record.index == shown else None,
    )


def _tag(step: Step, severity: Severity) -> str:
    words = PROVISIONAL if step.provisional else TAGS[severity], "keyframe" if step.key_frame else ""
    return " · ".join(dict.fromkeys(filter(None, words)))


def details(step: Step, record: ExposureRecord, here: FrameRecord) -> Details:
    """All that a step says."""
    own = registered(step.method)
    return Details(
        ", ".join(colours.label(part.method) for part in step.parts),
        tuple(_stages(step, own)),
        tuple(_group(step.method, a.question, a.text, a.checks, own.checks) for a in answers(step.decisions)),
        tuple(_facts(step, record, here)),
    )


def _group(method: str, question: str, text: str, made: tuple[Decision, ...], checks: Mapping[str, Check]) -> Group:
    measured = [d for d in made if d.kind == "finding" and not d.passed]
    crowd = measured if len(measured) >= CROWD else []
    rows = tuple(_check(method, d, checks) for d in made if d not in crowd)
    return Group(question, text, rows, tuple(_check(method, d, checks) for d in crowd))


def _stages(step: Step, own: Method) -> Iterator[Stage]:
    """Its own; those of the methods that it depends on are on their cards."""
    theirs = tuple(f"{part.method}: " for part in step.parts)
    for name, seconds in step.seconds.items():
        if not name.startswith(theirs):
            yield Stage(name, f"{1000 * seconds:.1f}", own.stages.get(name, ""))


def _check(method: str, decision: Decision, checks: Mapping[str, Check]) -> CheckRow:
    sign = mark(decision)
    about = f" ({decision.about})" if decision.about else ""
    return CheckRow(
        f"{method}.{decision.key}",
        sign,
        TINTS.get(sign, "quiet"),
        f"{decision.name}{about}; {HINTS[sign]}",
        sentence(decision, checks.get(decision.key)),
        _numbers(decision, checks.get(decision.key)),
        decision.name,
    )


def _numbers(decision: Decision, check: Check | None) -> str:
    """The value and the limit, where the check's sentence does not state them."""
    text = "" if check is None else check.passes if decision.passed else check.fails or check.passes
    return measured(decision) if text and "{threshold" not in text else ""


def _facts(step: Step, record: ExposureRecord, here: FrameRecord) -> Iterator[Fact]:
    name, unit_m = step.method, _unit_m(record, step)
    for camera, tracks in step.tracks.items():
        yield from _tracks(name, camera, tracks)
    if (inliers := here.number(INLIERS.key)) is not None:
        yield Fact("inliers", f"{inliers:.0f} {INLIERS.text}", f"{name}.{INLIERS.key}")
    if (median := here.number(RESIDUAL.key)) is not None:
        p95 = f", 95 % below {np.percentile(step.residuals_px, 95):.2f} px" if len(step.residuals_px) else ""
        yield Fact("residual", f"median {median:.2f} px{p95}", f"{name}.{RESIDUAL.key}")
    if text := describe(step, unit_m):
        yield Fact("pose", text, f"{name}.sigma_position")
    if here.error_m is not None:
        yield Fact("error", f"{length(here.error_m)} from the ground truth, {here.aligned}, as known now", ERROR.key)
    if (error := here.number(LIVE_ERROR.key)) is not None:
        text = f"{length(error)} from the true position, as the step gave it"
        yield Fact("distance to the true position", text, f"{name}.{LIVE_ERROR.key}")
    if step.provisional:
        yield Fact("pose", f"{PROVISIONAL}: waiting for the first stereo pairs", f"{name}.provisional")
    if step.scale is not None:
        yield Fact("scale", f"{step.scale:.4g} {registered(name).scale}", f"{name}.scale")
    if step.scale_sigma is not None:
        text = f"± {100 * step.scale_sigma:.2g} % since the start (1 sigma)"
        yield Fact("scale drift", text, f"{name}.scale_sigma")
    if step.seconds:
        yield Fact("time", computing_time(sum(step.seconds.values())), f"{name}.seconds")


def _tracks(method: str, camera: str, tracks: Tracks) -> Iterator[Fact]:
    """The numbers of tracks before, new, dropped and now, whose sum is right; and why they were dropped."""
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
