"""What a step decided, in words: each check as a sentence, with its threshold and margin, and grouped by question."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ispom.types import Check, Decision

LIMITS = {">=": "minimum", "<=": "limit", ">": "must be above", "<": "must be below", "=": "must be"}
TRIGGERS = {">=": "applies from", "<=": "applies up to", ">": "applies above", "<": "applies below", "=": "applies at"}
"""What a threshold is, by the relation of the passing side: of a requirement or a warning, and of a trigger."""


@dataclass(frozen=True)
class Answer:
    """The checks behind one question, in their order."""

    question: str
    """Empty for checks that stand for themselves."""
    text: str
    """The outcome in a few words; empty where there is no question."""
    checks: tuple[Decision, ...]


def answers(decisions: Iterable[Decision]) -> list[Answer]:
    """In the order of the decisions."""
    groups: dict[str, list[Decision]] = {}
    for decision in decisions:
        groups.setdefault(decision.question, []).append(decision)
    return [Answer(question, _answer(checks) if question else "", tuple(checks)) for question, checks in groups.items()]


def mark(decision: Decision) -> str:
    """A cross is a failure and nothing else; a trigger that did not fire is an empty circle, what is doubtful an !."""
    if decision.kind == "trigger":
        return "●" if decision.passed else "○"
    if decision.kind == "finding":
        return "·"
    if decision.kind == "warning":
        return "·" if decision.passed else "!"
    return "✓" if decision.passed else "✕"


def sentence(decision: Decision, check: Check | None) -> str:
    """The outcome and its consequence for people; in the words of the method's `check` where that has some."""
    text = "" if check is None else check.passes if decision.passed else check.fails or check.passes
    if text:
        value, threshold, margin = map(_InWords, (decision.value, decision.threshold, decision.margin))
        outcome = text.format(value=value, threshold=threshold, margin=margin)
    else:
        unit = f" {decision.unit}" if decision.unit else ""
        outcome = f"{decision.name[:1].upper()}{decision.name[1:]}: {number(decision.value)}{unit} ({limit(decision)})."
    return f"{outcome.removesuffix('.')}; {decision.consequence}." if decision.consequence else outcome


def limit(decision: Decision) -> str:
    """Which values are on the passing side, so that no reader takes it for the outcome: `minimum 12`."""
    unit = f" {decision.unit}" if decision.unit else ""
    if decision.kind == "finding":
        return f"compared with {number(decision.threshold)}{unit}"
    words = TRIGGERS if decision.kind == "trigger" else LIMITS
    return f"{words[decision.relation]} {number(decision.threshold)}{unit}"


def measured(decision: Decision) -> str:
    """The value, and the side of the threshold that passes: `0.157 deg (applies from 0.5 deg)`."""
    unit = f" {decision.unit}" if decision.unit else ""
    return f"{number(decision.value)}{unit} ({limit(decision)})"


def named(decision: Decision) -> str:
    return f"{decision.name} ({decision.about})" if decision.about else decision.name


def number(value: float) -> str:
    """Three digits, or all before the point."""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


class _InWords(float):
    """A number in a check's sentence: as everywhere, but where the sentence wants another format."""

    def __format__(self, spec: str) -> str:
        return super().__format__(spec).replace("%", " %") if spec else number(self)


def _answer(checks: list[Decision]) -> str:
    failed = [d for d in checks if d.failed]
    triggers = [d for d in checks if d.kind == "trigger"]
    fired = [d for d in triggers if d.passed]
    if failed:
        return f"No: {', '.join(map(named, failed))}"
    if triggers:
        return f"Yes: {', '.join(map(named, fired))}" if fired else f"No: 0 of {len(triggers)} triggers"
    return "Yes" if any(d.kind == "requirement" for d in checks) else ""
