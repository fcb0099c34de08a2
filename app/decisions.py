"""What a step decided, grouped by the question that its checks answer."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ispom.types import Decision

SIGNS = {">=": "≥", "<=": "≤"}


@dataclass(frozen=True)
class Answer:
    """The checks behind one question, in their order."""

    question: str
    """Empty for checks that stand for themselves."""
    text: str
    """What came out, in a few words; empty where nothing was asked."""
    checks: tuple[Decision, ...]


def answers(decisions: Iterable[Decision]) -> list[Answer]:
    """In the order in which the questions were asked."""
    groups: dict[str, list[Decision]] = {}
    for decision in decisions:
        groups.setdefault(decision.question, []).append(decision)
    return [Answer(question, _answer(checks) if question else "", tuple(checks)) for question, checks in groups.items()]


def mark(decision: Decision) -> str:
    """A cross is a failure and nothing else; a trigger that did not fire is an empty circle."""
    if decision.kind == "trigger":
        return "●" if decision.passed else "○"
    if decision.kind == "finding":
        return "·"
    return "✓" if decision.passed else "✕"


def measured(decision: Decision) -> str:
    """The value, and the threshold that it is held against: `0.157 deg (≥ 0.5)`."""
    unit, relation = f" {decision.unit}" if decision.unit else "", SIGNS.get(decision.relation, decision.relation)
    return f"{_number(decision.value)}{unit} ({relation} {_number(decision.threshold)})"


def named(decision: Decision) -> str:
    return f"{decision.name} ({decision.about})" if decision.about else decision.name


def _number(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _answer(checks: list[Decision]) -> str:
    failed = [d for d in checks if d.failed]
    triggers = [d for d in checks if d.kind == "trigger"]
    fired = [d for d in triggers if d.passed]
    if failed:
        return f"No: {', '.join(map(named, failed))}"
    if triggers:
        return f"Yes: {', '.join(map(named, fired))}" if fired else f"No: 0 of {len(triggers)} triggers"
    return "Yes" if any(d.kind == "requirement" for d in checks) else ""
