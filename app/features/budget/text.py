"""A budget in words."""

from __future__ import annotations

from ispom.evaluation.budget.budget import Budget, Share

from ...presentation.texts import length, length_unit
from .written import percent_of


def title(found: Budget) -> str:
    """Returns the heading of a method's budget."""
    ate = length(found.ate_m, length_unit([found.ate_m]))
    return f"{found.method}: ATE {ate} ({found.alignment}, {found.poses} poses); shares of its square"


def rows(found: Budget) -> list[tuple[str, str, str, str]]:
    """Returns cause, share, interval, and how it was removed: the largest first, then what cannot be told, and the
    rest."""
    tested = [cause for cause in found.causes if cause.share is not None]
    tested.sort(key=lambda cause: -cause.share.value_m2 if cause.share is not None else 0.0)
    table = [(c.name, *_cells(found, c.share), c.removed) for c in tested if c.share is not None]
    table += [(c.name, "cannot tell", "", c.unknown) for c in found.causes if c.share is None]
    return [*table, ("rest", *_cells(found, found.rest), "what no cause explains, and what causes do to each other")]


def _cells(found: Budget, share: Share) -> tuple[str, str]:
    percent, low, high = (percent_of(found, value) for value in (share.value_m2, share.low_m2, share.high_m2))
    return f"{percent:.0f} %", f"{low:.0f} to {high:.0f} %"
