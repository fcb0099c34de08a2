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
    """The definition of a quantity: its key, its kind and its help."""

    method: str
    """Empty for a quantity of the frame itself."""
    key: str
    kind: Kind
    help: str
    """One line for people."""
    unit: str = ""
    choices: tuple[str, ...] = ()
    """All values that a text can have."""

    @property
    def name(self) -> str:
        return f"{self.method}.{self.key}" if self.method else self.key


@dataclass(frozen=True)
class StepQuantity:
    """A quantity that the Step of every method has."""

    key: str
    of: Callable[[Step, float | None], Value]
    """Computes the value from a step and its distance from the truth [m], if that is known."""
    help: str
    kind: Kind = "number"
    unit: str = ""
    choices: tuple[str, ...] = ()


@dataclass(frozen=True)
class ChangeQuantity:
    """A quantity that is computed from a method's values at its previous step and at this one."""

    key: str
    of: Callable[[Mapping[str, Value], Mapping[str, Value]], Value]
    """Computes the value from two mappings by key. The first has the values at the method's previous step, including
    this quantity; it is empty at the first step and after a restart. The second has the values at this step, without
    the quantities that come later. `time_s` is the time of each step."""
    help: str
    kind: Literal["number", "flag"] = "number"
    unit: str = ""


def number_of(value: Value) -> float | None:
    """A flag as 0 or 1; None for a text."""
    return None if value is None or isinstance(value, str) else float(value)
