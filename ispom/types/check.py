"""Checks that estimators make: each is described once, and gives a Decision whenever it is made."""

from __future__ import annotations

import operator
from dataclasses import dataclass
from typing import Literal

from ispom.types.step import Decision, DecisionKind

Relation = Literal[">=", "<=", ">", "<"]
Topic = Literal["", "pose", "map", "scale", "motion", "loop"]
COMPARED = {">=": operator.ge, "<=": operator.le, ">": operator.gt, "<": operator.lt}


@dataclass(frozen=True)
class Check:
    """One kind of check; see Decision for what the fields mean. All of a method stand in its `checks.py`."""

    key: str
    name: str
    kind: DecisionKind
    question: str = ""
    relation: Relation = ">="
    unit: str = ""
    passes: str = ""
    """The sentence for people where it passes: "Key frame: moved {value} degrees, {threshold} are enough."; with
    {value}, {threshold} and {margin}, as numbers, and any format that a float has, as in {value:.0%}."""
    fails: str = ""
    """The same where it does not pass; empty: the same sentence. What comes before a colon, as in "Lost: {value}
    inliers ({threshold} needed).", is the headline of a verdict that the check decides."""
    topic: Topic = ""
    """What the outcome is about, for verdicts and events: `pose` finds the pose of the frame, `map` makes the first
    map, `scale` watches the scale, `motion` looks for a second motion, `loop` closes a loop."""

    def __post_init__(self) -> None:
        """ValueError where a sentence asks for anything else."""
        for text in (self.passes, self.fails):
            try:
                text.format(value=0.5, threshold=0.5, margin=0.5)
            except (LookupError, ValueError, AttributeError) as fault:
                raise ValueError(f"check {self.key!r} has a sentence that cannot be filled in: {text!r}") from fault

    def of(self, value: float, threshold: float, consequence: str = "", passed: bool | None = None) -> Decision:
        """As made now; `passed` where more than the comparison decides."""
        value, threshold = float(value), float(threshold)
        if passed is None:
            passed = bool(COMPARED[self.relation](value, threshold))
        return Decision(
            self.name,
            value,
            threshold,
            passed,
            self.unit,
            self.relation,
            consequence,
            self.key,
            self.question,
            self.kind,
        )


def by_key(*checks: Check) -> dict[str, Check]:
    """ValueError where two have the same key."""
    found = {check.key: check for check in checks}
    if len(found) < len(checks):
        raise ValueError(f"two checks have one key: {', '.join(sorted(check.key for check in checks))}")
    return found
