"""What the names of images tell of when they were taken: times, or numbers with gaps in them."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError

_STAMP = re.compile(r"(?<![0-9.])1(?:([0-9]{9})\.([0-9]{1,9})|([0-9]{18}|[0-9]{15}|[0-9]{12}))$")
"""Seconds with a fraction, or whole nano-, micro- or milliseconds since 1970, 2001 to 2033; a date begins with 2."""
IN_STEP = 0.5
"""Share of the intervals that are one step, or the numbers do not count images."""
SEVERAL = 0.5
"""Share of the numbers that images of two kinds have in common, or they are no kinds of images of one recording."""


@dataclass(frozen=True, eq=False)
class Named:
    """The images of a folder in the order in which they were taken."""

    names: tuple[str, ...]
    stamps_ns: NDArray[np.int64] | None = None
    """(N,) increasing; None where the names are not times."""
    numbers: NDArray[np.int64] | None = None
    """(N,) increasing; None where the names have no number each, or no times."""

    @property
    def step(self) -> int:
        """What numbers differ by from one image to the next where none is missing; 0 where they do not count images."""
        return 0 if self.numbers is None else _step(self.numbers)


def named(names: list[str]) -> Named:
    """By their times, or else by their numbers, 2 before 10.

    InputError where several images have one number: those of several cameras, or colours and depths.
    """
    stamps = {name: stamp for name in names if (stamp := _stamp(Path(name).stem)) is not None}
    if len(set(stamps.values())) == len(names) > 1 and len({_before(name) for name in names}) == 1:
        order = sorted(names, key=stamps.__getitem__)
        return Named(tuple(order), np.array([stamps[name] for name in order], np.int64))
    order = sorted(names, key=_order)
    _require_one_kind(order)
    found = [_number(name) for name in order]
    if len({kind for kind, _ in found}) > 1:
        return Named(tuple(order))
    numbers = [number for _, number in found]
    rising = -1 not in numbers and all(a < b for a, b in pairwise(numbers))
    return Named(tuple(order), None, np.array(numbers, np.int64) if rising else None)


def ticks_of(one: Named) -> NDArray[np.int64]:
    """(N,) how many images after the first each was taken, those counted that are missing."""
    if one.numbers is None or not one.step:
        return np.arange(len(one.names))
    return (one.numbers - one.numbers[0]) // one.step


def ticks_of_pair(left: Named, right: Named) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
    """The same of two cameras, (N,) and (M,), from the first of both on: images of one number were taken at once.

    None where the names do not tell.
    """
    if left.numbers is None or right.numbers is None:
        return None
    common = np.intersect1d(left.numbers, right.numbers)
    both = np.union1d(left.numbers, right.numbers)
    if len(common) < SEVERAL * min(len(left.numbers), len(right.numbers)) or not (step := _step(both)):
        return None
    return (left.numbers - both[0]) // step, (right.numbers - both[0]) // step


def _step(numbers: NDArray[np.int64]) -> int:
    apart = np.diff(numbers)
    if not len(apart):
        return 1
    step = int(np.gcd.reduce(apart))
    return step if (apart == step).mean() >= IN_STEP else 0


def _stamp(stem: str) -> int | None:
    """[ns] since 1970."""
    found = _STAMP.search(stem)
    if found is None:
        return None
    seconds, fraction, whole = found.groups()
    return int(f"1{seconds}{fraction:0<9}" if whole is None else f"1{whole:0<18}")


def _before(name: str) -> str:
    """What a name has before its time."""
    return _STAMP.sub("", Path(name).stem)


def _number(name: str) -> tuple[str, int]:
    """What kind of image it is, by all that is not the last number in its name, and that number; -1 without one."""
    path = Path(name)
    found = re.fullmatch(r"(.*?)([0-9]{1,18})([^0-9]*)", path.stem)
    kind = path.suffix.lower()
    return (path.stem + kind, -1) if found is None else (f"{found[1]}#{found[3]}{kind}", int(found[2]))


def _require_one_kind(names: list[str]) -> None:
    kinds: dict[str, list[str]] = {}
    for name in names:
        kinds.setdefault(_number(name)[0], []).append(name)
    if len(kinds) < 2:
        return
    first, second = (kind for kind, _ in Counter({k: len(v) for k, v in kinds.items()}).most_common(2))
    numbers = [{_number(name)[1] for name in kinds[kind]} for kind in (first, second)]
    common = numbers[0] & numbers[1] - {-1}
    words = [re.sub("[0-9]", "", kind) for kind in (first, second)]
    parts = words[0] == words[1] and "cam" not in words[0].lower()  # of one recording, each counted from its first
    if len(common) >= max(2, SEVERAL * len(numbers[0])) and not parts:
        raise InputError(
            f"images of several kinds have the same numbers ({kinds[first][0]} and {kinds[second][0]}): give those of "
            "each camera, and depth images, a folder of their own"
        )


def _order(name: str) -> tuple[tuple[int, str], ...]:
    """Numbers in the name by value; every second part of the split is a number."""
    parts = re.split(r"([0-9]+)", name)
    return tuple((int(part), part) if i % 2 else (0, part) for i, part in enumerate(parts))
