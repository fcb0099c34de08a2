"""Verdicts and their checks, for agents."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from ispom.methods import method as registered
from ispom.types import Decision

from ...engine.error_curve import ErrorCurve
from ...engine.frame_record import INLIERS, LIVE_ERROR, RESIDUAL, FrameRecord
from ...engine.history.record import ExposureRecord
from ...engine.verdict import alarming
from ...presentation.decisions import sentence
from ...session.branches.state import Branches
from ...session.current_run import CurrentRun
from ..agents.agent_session import AgentSession
from ..agents.tool import MOST_ROWS, Tool, brief
from .card import Card, cards


def verdict_at(
    agents: AgentSession,
    frame: Annotated[int, "Frame, from 0."],
    method: Annotated[str, "Only this method; empty for all."] = "",
    all_checks: Annotated[bool, "List every check of the frame, not the failed and decisive ones alone."] = False,
) -> dict[str, Any]:
    """Says how each method did at a frame, and why: severity (ok, keyframe, provisional, warning, lost), one
    sentence, the check that decided it, and the checks that failed, the most severe first. A check has key
    (METHOD.KEY, for checks_over_time and condition_test), value, threshold, unit, margin (negative: on the failing
    side), passed, and kind: requirement and warning can fail; trigger and finding cannot. A method that did not step
    at the frame has the verdict of its last step, `frame` says which. `numbers` has inliers (tracks that the pose
    used), residual_median_px, error_m (live error: of the pose as given then, not aligned) and, of the trajectory as
    known now after the alignment of the ATE, error_aligned_m with `aligned`; null where unknown."""
    run, index = agents.run, agents.frame(frame)
    if method:
        agents.method(method)
    record = run.history[index]
    latest = _latest(run, index)
    curves = agents.state[Branches].curves
    found = [card for card in cards(record, run.opened.methods, latest) if method in ("", card.verdict.method)]
    rows = [
        _row(card, (record, *latest.values()), all_checks) | _numbers(record, card.verdict.method, curves)
        for card in found
    ]
    return {"frame": index, "time_s": record.time_ns / 1e9, "image": record.kind, "verdicts": rows}


def _latest(run: CurrentRun, index: int) -> dict[str, ExposureRecord]:
    """By method, the record of its last step up to a frame."""
    steps = {method: run.series.last_step(method, index) for method in run.opened.methods}
    return {method: run.history[at] for method, at in steps.items() if at is not None}


def _row(card: Card, records: tuple[ExposureRecord, ...], all_checks: bool) -> dict[str, Any]:
    verdict = card.verdict
    row: dict[str, Any] = {
        "method": verdict.method,
        "frame": verdict.frame,
        "severity": str(verdict.severity),
        "word": verdict.headline,
        "sentence": verdict.sentence,
        "decisive": None if verdict.decisive is None else _check(verdict.method, verdict.decisive),
        "failed": [_check(verdict.method, decision) for decision in verdict.failed],
    }
    if all_checks:
        steps = (step for record in records if record.index == verdict.frame for step in record.steps)
        made = next((step.decisions for step in steps if step.method == verdict.method), ())
        row["checks"] = [_check(verdict.method, decision) for decision in made[:MOST_ROWS]]
    return row


def _numbers(record: ExposureRecord, method: str, curves: Mapping[str, ErrorCurve]) -> dict[str, Any]:
    here = FrameRecord(method, record, curves.get(method))
    found = {definition.key: here.number(definition.key) for definition in (INLIERS, RESIDUAL, LIVE_ERROR)}
    found["error_aligned_m"] = here.error_m
    return {"numbers": {key: None if value is None else brief(value) for key, value in found.items()}
            | {"aligned": here.aligned}}  # fmt: skip


def _check(method: str, decision: Decision) -> dict[str, Any]:
    return {
        "key": f"{method}.{decision.key}",
        "name": decision.name,
        "about": decision.about,
        "kind": decision.kind,
        "value": brief(decision.value),
        "relation": decision.relation,
        "threshold": brief(decision.threshold),
        "unit": decision.unit,
        "margin": brief(decision.margin),
        "passed": bool(decision.passed),
        "alarming": alarming(decision),
        "sentence": sentence(decision, registered(method).checks.get(decision.key)),
    }


TOOLS = (Tool(verdict_at),)
