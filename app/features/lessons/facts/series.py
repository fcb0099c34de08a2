"""What the quantities of a run (METHOD.KEY) come to over its exposures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Array

from ....engine.conditions.matches import hits
from ....engine.conditions.parser import parse
from ..ran import Ran


def median(ran: Ran, quantity: str) -> float:
    """Over the exposures on which it was said."""
    return float(np.median(_said(ran, quantity)[1]))


def largest(ran: Ran, quantity: str) -> float:
    return float(np.max(_said(ran, quantity)[1]))


def total(ran: Ran, quantity: str) -> float:
    """Of a flag, how often it was true."""
    return float(np.sum(_said(ran, quantity)[1]))


def last(ran: Ran, quantity: str) -> float:
    return float(_said(ran, quantity)[1][-1])


def holds_percent(ran: Ran, condition: str) -> float:
    """At which share of the exposures on which its methods stepped a condition holds [%]."""
    expression = parse(condition, ran.series.quantities)
    stepped = sum(ran.series.stepped(expression.methods, i) for i in range(ran.count))
    return 100 * hits(expression, ran.series, ran.count) / max(stepped, 1)


def quantity_curve(ran: Ran, quantity: str) -> tuple[Array, Array]:
    """Over time since the first exposure [s]."""
    at, values = _said(ran, quantity)
    return (ran.sequence.times_ns[at] - ran.sequence.times_ns[0]) * 1e-9, values


def _said(ran: Ran, quantity: str) -> tuple[NDArray[np.int64], Array]:
    if quantity not in ran.series.quantities:
        raise InputError(f"{quantity!r} is no quantity of this run: give METHOD.KEY")
    at, values = ran.series.said(quantity, ran.count)
    known = np.isfinite(values)
    if not known.any():
        raise InputError(f"nothing was said of {quantity} in this run")
    return at[known], values[known]
