"""What a step decided, in words: grouped by the question that its checks answer, and each as a sentence."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ispom.types import Check, Decision

SIGNS = {">=": "≥", "<=": "≤"}
WANTED = {">=": "at least", "<=": "at most", ">": "more than", "<": "less than", "=": "exactly"}


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
        said = text.format(value=value, threshold=threshold, margin=margin)
    else:
        unit = f" {decision.unit}" if decision.unit else ""
        wanted = f"{WANTED[decision.relation]} {number(decision.threshold)}"
        said = f"{decision.name[:1].upper()}{decision.name[1:]}: {number(decision.value)}{unit}, {wanted} wanted."
    return f"{said.removesuffix('.')}; {decision.consequence}." if decision.consequence else said


def measured(decision: Decision) -> str:
    """The value, and the threshold that it is held against: `0.157 deg (≥ 0.5)`."""
    unit, relation = f" {decision.unit}" if decision.unit else "", SIGNS.get(decision.relation, decision.relation)
    return f"{number(decision.value)}{unit} ({relation} {number(decision.threshold)})"


def margin(decision: Decision) -> str:
    """By how much it passed, with its sign and unit: `margin +0.7 deg`, `margin −1.3 deg` where it did not.

    Where the outcome is another one than the comparison's, as of a size with either sign, it says that instead.
    """
    if decision.margin and (decision.margin > 0) != decision.passed:
        return "not by this alone"
    unit, sign = f" {decision.unit}" if decision.unit else "", "−" if decision.margin < 0 else "+"
    return f"margin {sign}{number(abs(decision.margin))}{unit}"


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
