"""Values of options that have a grammar of their own."""

from __future__ import annotations

import math
import re

from ispom.errors import InputError
from ispom.evaluation.comparison import Delta


def delta_of(text: str) -> Delta:
    """Returns the distance of `10`, `1m` or `0.5s`. Raises InputError for anything else."""
    found = re.fullmatch(r"([0-9]{1,9}(?:\.[0-9]{1,9})?)(m|s)?", text.strip())
    if found is not None and float(found[1]) > 0:
        if found[2] == "m":
            return Delta(float(found[1]), "m")
        if found[2] == "s":
            return Delta(float(found[1]), "s")
        if float(found[1]).is_integer():
            return Delta(int(float(found[1])))
    raise InputError(f"--delta must be at least 1 pose, or a length or time: '{text[:40]}' is none of 10, 1m and 0.5s")


def spans_of(texts: tuple[str, ...]) -> tuple[tuple[float, float], ...]:
    """Returns stretches FROM:TO [s], of which each end may be missing. Raises InputError for anything else."""
    spans = []
    for text in texts:
        ends = text.split(":")
        try:
            first, last = (float(end) if end.strip() else None for end in ends)
        except ValueError:
            first = last = math.nan
        first, last = -math.inf if first is None else first, math.inf if last is None else last
        if not first <= last:
            raise InputError(f"--exclude '{text[:60]}' is no stretch: give FROM:TO in seconds")
        spans.append((first, last))
    return tuple(spans)
