"""The quantities that every method has. Each file of this folder has `QUANTITIES`; a new file adds its own: a
`StepQuantity`, which a Step says, or a `ChangeQuantity`, which also sees the step before and the times."""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

from ..quantity import ChangeQuantity, StepQuantity

FIRST = ("step", "motion")
"""Files whose quantities come first, in the order of the columns of steps.csv. All other files can use these."""


def step_quantities() -> tuple[StepQuantity, ...]:
    """Returns the quantities of a Step alone. ValueError if two quantities have the same key."""
    return tuple(quantity for quantity in _quantities() if isinstance(quantity, StepQuantity))


def change_quantities() -> tuple[ChangeQuantity, ...]:
    """Returns the quantities of a step and the step before, each after those that it uses. ValueError if two have the
    same key."""
    return tuple(quantity for quantity in _quantities() if isinstance(quantity, ChangeQuantity))


def _quantities() -> list[StepQuantity | ChangeQuantity]:
    names = sorted(
        (module.name for module in iter_modules(__path__)), key=lambda name: (name not in FIRST, name != FIRST[0], name)
    )
    found = [quantity for name in names for quantity in import_module(f"{__name__}.{name}").QUANTITIES]
    if len({quantity.key for quantity in found}) < len(found):
        raise ValueError(f"two quantities have one key: {', '.join(quantity.key for quantity in found)}")
    return found
