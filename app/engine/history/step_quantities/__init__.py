"""The quantities that every method's Step has. Each file of this folder has `QUANTITIES`; a new file adds its own."""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

from ..quantity import StepQuantity

FIRST = "step"
"""The file whose quantities come first, in the order of the columns of steps.csv."""


def step_quantities() -> tuple[StepQuantity, ...]:
    """All of them. ValueError if two have one key."""
    names = sorted((module.name for module in iter_modules(__path__)), key=lambda name: (name != FIRST, name))
    found = [quantity for name in names for quantity in import_module(f"{__name__}.{name}").QUANTITIES]
    if len({quantity.key for quantity in found}) < len(found):
        raise ValueError(f"two quantities have one key: {', '.join(quantity.key for quantity in found)}")
    return tuple(found)
