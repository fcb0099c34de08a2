"""What undecided.json holds."""

from __future__ import annotations

import msgspec

from ispom.evaluation.undecided.motions import Moved
from ispom.evaluation.undecided.stretches import Answer
from ispom.evaluation.undecided.weakest import DECIDED_PX


class PartRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A number's part in the weakest combination."""

    name: str
    value: float
    """How much it changes, in its own unit, at one standard deviation of the combination."""
    px: float
    """By how much this alone would move the points."""


class Motion(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the camera moved, in its own axes."""

    turned_deg: float
    axis: tuple[float, float, float]
    distance: float
    """Over the median distance of the points."""
    direction: tuple[float, float, float]


class StretchRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One stretch. Times in seconds are since the first stretch."""

    first_s: float
    last_s: float
    first_ns: int
    last_ns: int
    decided: bool
    weakest_px: float | None
    """By how much the weakest combination would move the points, at one standard deviation; null where nothing is
    decided."""
    weakest: list[PartRow]
    sigmas: dict[str, float]
    """Standard deviation of each number in its own unit, with all others free."""
    motion: Motion | None
    cures_px: dict[str, float]
    """By motion: what would be left of `weakest_px` after it."""
    best_cure: str | None


class UndecidedFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What undecided.json holds."""

    name: str
    """Of the recording, or of the motion."""
    limit_px: float
    """A combination is decided that moves the points by no more."""
    stretches: list[StretchRow]


def written(name: str, answers: list[Answer]) -> UndecidedFile:
    """Returns what undecided.json holds."""
    return UndecidedFile(name, DECIDED_PX, [_row(each, answers[0].first_ns) for each in answers])


def _row(answer: Answer, start_ns: int) -> StretchRow:
    found = answer.decided
    parts = () if found is None else found.weakest
    return StretchRow(
        (answer.first_ns - start_ns) * 1e-9,
        (answer.last_ns - start_ns) * 1e-9,
        answer.first_ns,
        answer.last_ns,
        found is not None and found.weakest_px <= DECIDED_PX,
        None if found is None else found.weakest_px,
        [PartRow(part.name, part.value, part.px) for part in parts],
        {} if found is None else {each: found.sigma(each) for each in found.names},
        None if found is None or answer.moved is None else _motion(answer.moved),
        answer.cures,
        answer.best_cure,
    )


def _motion(moved: Moved) -> Motion:
    (x, y, z), (right, down, ahead) = moved.axis.tolist(), moved.direction.tolist()
    return Motion(moved.turned_deg, (x, y, z), moved.distance, (right, down, ahead))
