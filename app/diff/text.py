"""A comparison of two runs for people."""

from __future__ import annotations

from collections.abc import Iterator

from .compare import ORIENTATION, Difference, Divergence

MOST = 8
"""Quantities that are shown of an exposure."""


def lines(divergence: Divergence) -> Iterator[str]:
    """The exposure, and what differs there first."""
    at = "final" if divergence.exposure is None else f"exposure {divergence.exposure}"
    yield f"{at} ({divergence.time_ns / 1e9:.3f} s)"
    shown = divergence.differences[:MOST]
    yield from (f"  {_line(difference)}" for difference in shown)
    if left := len(divergence.differences) - len(shown):
        yield f"  and {left} more"


def shown(value: object) -> str:
    """A value of one side: all digits that tell it from others."""
    if value is None:
        return "missing"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple):
        return f"({', '.join(map(shown, value))})"
    return f"{value!r}" if isinstance(value, int | float) else str(value) or "empty"


def _line(difference: Difference) -> str:
    by = "" if difference.by is None else f", apart by {difference.by:.3g}{_unit(difference)}"
    return f"{difference.name}: {shown(difference.a)} | {shown(difference.b)}{by}"


def _unit(difference: Difference) -> str:
    return " deg" if difference.name.endswith(ORIENTATION) else ""
