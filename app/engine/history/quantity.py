"""What a quantity of a frame is."""

from __future__ import annotations

from collections.abc import Callable
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
