"""A comparison of two runs for people."""

from __future__ import annotations

from collections.abc import Iterator

from ...engine.differences.compare import DIGEST, ORIENTATION, POSITION, Difference, Divergence

MOST = 8
"""Quantities that are shown of a frame."""
FEW, LOSSLESS = 4, 17
"""Significant digits."""


def lines(divergence: Divergence) -> Iterator[str]:
    """The frame, and what differs there first; the distance of the positions, whatever comes before them."""
    at = "final" if divergence.exposure is None else f"frame {divergence.exposure}"
    yield f"{at} ({divergence.time_ns / 1e9:.3f} s)"
    first, rest = divergence.differences[:MOST], divergence.differences[MOST:]
    positions = tuple(d for d in rest if d.name.endswith(POSITION))
    yield from (f"  {_line(difference)}" for difference in (*first, *positions))
    if left := len(rest) - len(positions):
        yield f"  and {left} more"


def shown(value: object, digits: int = LOSSLESS) -> str:
    """Returns the text of a value of one side, with `digits` significant digits."""
    if value is None:
        return "missing"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple):
        return f"({', '.join(shown(part, digits) for part in value)})"
    if isinstance(value, float):
        return f"{value!r}" if digits >= LOSSLESS else f"{value:.{digits}g}"
    return str(value) if value != "" else "empty"


def _line(difference: Difference) -> str:
    if difference.name.endswith(DIGEST):
        return f"{difference.name}: differs"
    by = "" if difference.by is None else f", apart by {difference.by:.3g}{_unit(difference)}"
    a, b = distinct(difference.a, difference.b)
    return f"{difference.name}: {a} | {b}{by}"


def distinct(a: object, b: object) -> tuple[str, str]:
    """Both sides, with as many digits as show the difference, and a few at least."""
    both = ((shown(a, digits), shown(b, digits)) for digits in range(FEW, LOSSLESS + 1))
    return next((pair for pair in both if pair[0] != pair[1]), (shown(a), shown(b)))


def _unit(difference: Difference) -> str:
    return " deg" if difference.name.endswith(ORIENTATION) else ""
