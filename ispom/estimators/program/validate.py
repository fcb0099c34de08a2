"""Checks of the values in an answer. All raise ProgramFault, whose text continues a sentence."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from ispom.estimators.program.pipe import ProgramFault

QUOTED = 40
LARGEST_ID = 1 << 53


def known(answer: dict[str, Any], names: Iterable[str], where: str) -> None:
    """Refuses names other than these."""
    if unknown := sorted(answer.keys() - set(names)):
        raise ProgramFault(f"answers with {unknown[0][:QUOTED]!r}, which {where} does not have")


def mapping(value: Any, where: str) -> dict[str, Any]:
    """Returns an object."""
    if not isinstance(value, dict):
        raise wrong(where, value, "an object")
    return value


def items(value: Any, where: str, most: int, exactly: int | None = None) -> list[Any]:
    """Returns a list of at most `most`, or of `exactly`, entries."""
    if not isinstance(value, list) or len(value) > most or exactly not in (None, len(value)):
        raise wrong(where, value, f"a list of {exactly}" if exactly is not None else f"a list of at most {most}")
    return value


def number(value: Any, where: str) -> float:
    """Returns a finite number."""
    try:
        if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
            return float(value)
    except OverflowError:
        pass
    raise wrong(where, value, "a finite number")


def count(value: Any, where: str, most: int) -> int:
    """Returns an integer from 0 to `most`."""
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= most:
        raise wrong(where, value, f"an integer from 0 to {most}")
    return value


def choice(value: Any, where: str, choices: Iterable[str]) -> Any:
    """Returns one of the choices."""
    listed = tuple(choices)
    if not isinstance(value, str) or value not in listed:
        raise wrong(where, value, f"one of {', '.join(repr(c) for c in listed)}")
    return value


def boolean(value: Any, where: str) -> bool:
    """Returns true or false."""
    if not isinstance(value, bool):
        raise wrong(where, value, "true or false")
    return value


def text(value: Any, where: str) -> str:
    """Returns a text of one line."""
    if not isinstance(value, str) or len(value) > 200 or not value.isprintable():
        raise wrong(where, value, "a text of one line, up to 200 characters")
    return value


def wrong(where: str, value: Any, expected: str) -> ProgramFault:
    """Returns the fault for a value that is not as expected."""
    shown = repr(value)
    return ProgramFault(
        f"answers with {where} {shown if len(shown) <= QUOTED else shown[:QUOTED] + '…'}, not {expected}"
    )
