"""What a quantity of a frame is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from ispom.types import Step

Kind = Literal["number", "flag", "text"]
Value = float | bool | str | None
"""A finite number, a flag, a text; None where there is no value."""


@dataclass(frozen=True)
class Quantity:
    """What stands under a key."""

    method: str
    """Empty for those of the frame itself."""
    key: str
    kind: Kind
    help: str
    """One line for people."""
    unit: str = ""
    choices: tuple[str, ...] = ()
    """All that a text can be."""

    @property
    def name(self) -> str:
        return f"{self.method}.{self.key}" if self.method else self.key


@dataclass(frozen=True)
class StepQuantity:
    """What every method's Step says."""

    key: str
    of: Callable[[Step, float | None], Value]
    """Of a step, and its distance from the truth [m] where that is known."""
    help: str
    kind: Kind = "number"
    unit: str = ""
    choices: tuple[str, ...] = ()


@dataclass(frozen=True)
class ChangeQuantity:
    """What follows from a method's values at its step before and at this one."""

    key: str
    of: Callable[[Mapping[str, Value], Mapping[str, Value]], Value]
    """By key: the values at the method's step before (empty before the first, and over a restart), this quantity's own
    included; and those at this step, without the quantities that come later. `time_s` is the time of each step."""
    help: str
    kind: Literal["number", "flag"] = "number"
    unit: str = ""


def number_of(value: Value) -> float | None:
    """A flag as 0 or 1; None for a text."""
    return None if value is None or isinstance(value, str) else float(value)
