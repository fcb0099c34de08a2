"""The times of images from their names, which are times, or numbers with gaps."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from decimal import Decimal
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.io.pose_table import unpadded_nanoseconds

_STAMP = re.compile(r"(?<![0-9.])1(?:([0-9]{9})\.([0-9]{1,9})|([0-9]{18}|[0-9]{15}|[0-9]{12}|[0-9]{9}))$")
"""Seconds with or without a fraction, or whole nano-, micro- or milliseconds since 1970. They begin with 1, from 2001
to 2033; a date of this century begins with 2."""
_SECONDS = re.compile(
    r"(?P<value>(?:^-)?(?<![0-9.,])[0-9]{1,19}(?:[.,](?P<fraction>[0-9]{1,20}))?(?P<exponent>e[-+][0-9]{1,2})?)"
    r"[ _]?(?P<unit>s|secs?|seconds|ms|msec|us|usec|ns|nsec)?$"
)
"""Times from the start of the recording; some have a fraction, or all a unit. Without a unit they are seconds."""
_UNITS_NS = {"": 10**9, "s": 10**9, "m": 10**6, "u": 10**3, "n": 1}
_SECONDS_NANOSECONDS = re.compile(r"(?<![0-9.])1[0-9]{9}[._][0-9]{1,9}$")
"""Seconds since 1970, and nanoseconds."""
_DATE = re.compile(
    r"(?<![0-9])((?:19|20)[0-9]{2})([-_.]?)([0-9]{2})\2([0-9]{2})[-_.T ]{0,3}([0-9]{2})([-_.:hm]?)([0-9]{2})[-_.:hm]?"
    r"([0-9]{2})(?:[.,]([0-9]{1,9})|[-_]?([0-9]{3}|[0-9]{6}|[0-9]{9}))?[sZ]?$"
)
"""A date and a time of day, perhaps with a fraction of the second."""
_LAST_NUMBER = re.compile(r"(.*?)([0-9]{1,18})([^0-9]*)")
MIN_INTERVAL_NS, MAX_INTERVAL_NS = 1_000_000, 10_000_000_000
"""Range of the median interval of images whose names are interpreted as times."""
MAX_TIME_NS = 4_600_000_000 * 10**9
"""Latest time: in 2115, counted since 1970."""
MIN_STEP_OF_TIMES = 5_000
"""Least step of numbers that are times; smaller steps count images."""
UNITS = {"milliseconds": 1_000_000, "microseconds": 1_000, "nanoseconds": 1}
"""Units of whole numbers that are times [ns], from the longest to the shortest."""
MAX_JITTER = 0.1
"""Largest deviation of an image's time from a constant rate, relative to the interval."""
COUNTER_MAXIMA = (99, 255, 999, 9_999, 32_767, 65_535, 99_999, 999_999)
"""Largest values of counters, after which they start again: decimal ones at 1, binary ones at 0."""
MAX_WRAP_STEPS, MAX_WRAP_SHARE = 10, 0.5
"""Largest number of steps between the last image before a counter starts again and the first one after it, and largest
share of the counter's range that the images use."""
MIN_REGULAR_SHARE = 0.5
"""Least share of intervals of exactly one step, if numbers count images."""
MIN_COMMON_SHARE = 0.5
"""Least share of common numbers of two kinds of images in one recording, such as those of two cameras."""


@dataclass(frozen=True, eq=False)
class Named:
    """The images of a folder in the order in which they were taken."""

    names: tuple[str, ...]
    stamps_ns: NDArray[np.int64] | None = None
    """(N,) increasing; None where the names are not times."""
    numbers: NDArray[np.int64] | None = None
    """(N,) increasing; None where the names have no numbers, or where these are times."""
    unread: NDArray[np.int64] | None = None
    """(K,) numbers of images among them in unsupported formats."""
    notes: tuple[str, ...] = ()
    """Sentences about ambiguous names."""

    @property
    def step(self) -> int:
        """The difference of the numbers of consecutive images; 0 where numbers do not count images."""
        if self.numbers is None:
            return 0
        return _step(self.numbers if self.unread is None else np.union1d(self.numbers, self.unread))


def named(names: list[str], unread: list[str] | None = None) -> Named:
    """Orders images by the times in their names, or else by the numbers, 2 before 10.

    `unread` are names of images in unsupported formats, whose numbers are gaps. Raises InputError where several images
    have one number, as those of several cameras, or colours and depths.
    """
    if (unpadded := _unpadded(names)) is not None:
        return unpadded
    for stamp in (_stamp, _date):
        stamps = {name: ns for name in names if (ns := stamp(Path(name).stem)) is not None}
        if len(set(stamps.values())) == len(names) > 1 and len({_before(name, stamp) for name in names}) == 1:
            order = sorted(names, key=stamps.__getitem__)
            stamps_ns = np.array([stamps[name] for name in order], np.int64)
            if stamp is _stamp or _is_likely(np.diff(stamps_ns)):
                return Named(tuple(order), stamps_ns)
    in_seconds = _of_seconds(names)
    return _counted(names, unread or []) if in_seconds is None else in_seconds


def _unpadded(names: list[str]) -> Named | None:
    """Orders names that are seconds since 1970 and nanoseconds without leading zeros, with a point or _ between them;
    None for other names."""
    matches = [_SECONDS_NANOSECONDS.search(Path(name).stem) for name in names]
    words = [match[0] for match in matches if match is not None]
    if len(words) < len(names) or len({_SECONDS_NANOSECONDS.sub("", Path(name).stem) for name in names}) > 1:
        return None
    times = unpadded_nanoseconds(words)
    if times is None or len(set(times.tolist())) < len(names) or not _is_likely(np.diff(np.sort(times))):
        return None
    order = np.argsort(times)
    note = "the names of the images are seconds and nanoseconds without leading zeros"
    return Named(tuple(names[i] for i in order), times[order], notes=(note,))


def _counted(names: list[str], unread: list[str]) -> Named:
    """Orders images by the numbers in their names."""
    order = sorted(names, key=_order)
    _require_one_kind(order)
    parts = [_number(name) for name in order]
    if len({Path(kind).stem for kind, _ in parts}) > 1:  # not counting the file formats
        return Named(tuple(order))
    numbers = [number for _, number in parts]
    if -1 in numbers or not all(a < b for a, b in pairwise(numbers)):
        return Named(tuple(order))
    kind = Path(parts[0][0]).stem
    others = {number for other, number in map(_number, unread) if Path(other).stem == kind} - {*numbers, -1}
    both = np.array(sorted({*numbers, *others}), np.int64)
    counts, note = _unwrapped(both, _padded(order))
    count_of = dict(zip(both.tolist(), counts.tolist(), strict=True))
    pairs = sorted((count_of[number], name) for number, name in zip(numbers, order, strict=True))
    left_out = np.array(sorted(count_of[number] for number in others), np.int64) if others else None
    numbered = np.array([count for count, _ in pairs], np.int64)
    one = Named(tuple(name for _, name in pairs), None, numbered, left_out, (note,) if note else ())
    return one if others or note else _of_whole_numbers(one)


def _padded(names: list[str]) -> int:
    """Returns the number of digits to which numbers are filled with zeros; 0 where they are not."""
    digits = [match[2] for name in names if (match := _LAST_NUMBER.fullmatch(Path(name).stem)) is not None]
    widths = {len(each) for each in digits}
    return widths.pop() if len(widths) == 1 and any(each[0] == "0" and len(each) > 1 for each in digits) else 0


def _of_seconds(names: list[str]) -> Named | None:
    """Orders names that are decimal seconds, of which at least one has a fraction, or times with a unit; None for other
    names, such as versions and counters with points."""
    matches = [_SECONDS.search(Path(name).stem) for name in names]
    parts = [match for match in matches if match is not None]
    units = {match["unit"] or "" for match in parts}
    kinds = {_SECONDS.sub("", Path(name).stem) for name in names}
    if len(parts) < max(2, len(names)) or len(kinds) > 1 or len(units) > 1:
        return None
    has_fraction = any(match["fraction"] is not None for match in parts)
    if not any(units) and (not has_fraction or _are_counters(parts)):
        return None
    unit_ns = _UNITS_NS[units.pop()[:1]]
    stamps = {name: _time_ns(match["value"], unit_ns) for name, match in zip(names, parts, strict=True)}
    order = sorted(names, key=stamps.__getitem__)
    if max(abs(stamps[name]) for name in order) > MAX_TIME_NS:
        return None
    stamps_ns = np.array([stamps[name] for name in order], np.int64)
    return Named(tuple(order), stamps_ns) if _is_likely(np.diff(stamps_ns)) else None


def _are_counters(parts: list[re.Match[str]]) -> bool:
    """Checks for counters with points among numbers without a unit, such as 1.9 and 1.10, or 1.00, 1.01, 2.00.

    Seconds are printed with a constant number of digits, or without zeros at the end.
    """
    if any(match["exponent"] for match in parts):
        return False
    fractions = [match["fraction"] for match in parts if match["fraction"] is not None]
    if len(fractions) == len(parts) and len({len(fraction) for fraction in fractions}) == 1:
        return _is_counter([_both_sides(match["value"]) for match in parts])
    return any(fraction.endswith("0") and fraction != "0" for fraction in fractions)


def _both_sides(value: str) -> tuple[int, int]:
    """Returns the whole numbers before and after the point."""
    before, _, after = value.replace(",", ".").partition(".")
    return int(before), int(after or 0)


def _time_ns(value: str, unit_ns: int) -> int:
    return int((Decimal(value.replace(",", ".")) * unit_ns).to_integral_value())


def _is_counter(parts: list[tuple[int, int]]) -> bool:
    """Checks whether the numbers after the point count 0, 1, 2 or 1, 2, 3 for each number before it: 1.00, 1.01,
    2.00."""
    after: dict[int, list[int]] = {}
    for before, fraction in sorted(parts):
        after.setdefault(before, []).append(fraction)
    counted = all(each[0] in (0, 1) and each == [*range(each[0], each[0] + len(each))] for each in after.values())
    sizes = {len(each) for each in after.values()}
    full = len(after) > 1 and max(sizes) == 10  # 0.8, 0.9, 1.0: tenths of seconds
    return counted and (len(after) > 1 or min(after) > 0) and not full


def _of_whole_numbers(one: Named) -> Named:
    """Interprets the numbers as times, if their step is not constant, as that of rounded times (0, 33, 67, 100), or too
    large for a counter; else returns the images unchanged."""
    if one.numbers is None:
        return one
    steps = np.diff(one.numbers)
    if len(steps) < 3 or 0 < one.step < MIN_STEP_OF_TIMES:
        return one
    ticks = np.rint(steps / np.median(steps))
    if not ticks.all() or (ticks == 1).mean() < MIN_REGULAR_SHARE:
        return one
    interval = steps.sum() / ticks.sum()
    late = one.numbers - one.numbers[0] - interval * np.concatenate([[0], np.cumsum(ticks)])
    if interval < 1 / MAX_JITTER or np.abs(late).max() > max(1.0, MAX_JITTER * interval):
        return one
    for unit, unit_ns in UNITS.items():
        if MIN_INTERVAL_NS < interval * unit_ns <= 1_000_000_000:
            note = f"the numbers in the names of the images are taken as times in {unit} (rate_hz says otherwise)"
            return replace(one, stamps_ns=one.numbers * unit_ns, numbers=None, notes=(note,))
    return one


def _unwrapped(numbers: NDArray[np.int64], padded: int) -> tuple[NDArray[np.int64], str]:
    """Returns numbers (N,) that continue where a counter started again (9998, 9999, 1, 2), and a note about that.

    `numbers` (N,) are increasing; `padded` is the number of digits to which zeros fill them, or 0.
    """
    steps = np.diff(numbers)
    if len(steps) < 2:
        return numbers, ""
    first = int(np.argmax(steps)) + 1
    low, high = numbers[:first], numbers[first:]
    step = _step(low) if len(low) > 1 else _step(high)
    if not step or (len(high) > 1 and _step(high) != step):
        return numbers, ""
    for most in COUNTER_MAXIMA:
        starts_at_1 = str(most).strip("9") == "" and low[0] > 0
        turn = most if starts_at_1 and (low[0] + most - high[-1]) % step == 0 else most + 1
        across = int(low[0] + turn - high[-1])
        if high[-1] > most or (padded and padded != len(str(most))) or steps[first - 1] <= MAX_WRAP_SHARE * most:
            continue
        if across % step == 0 and across <= min(MAX_WRAP_STEPS * step, MAX_JITTER * most):
            note = f"the counter in the names of the images starts again after {most}: {low[0]} follows {high[-1]}"
            return np.where(np.arange(len(numbers)) < first, numbers + turn, numbers), note
    return numbers, ""


def _is_likely(intervals_ns: NDArray[np.int64]) -> bool:
    """Checks that intervals are positive, and their median is a plausible one of images."""
    return bool((intervals_ns > 0).all()) and MIN_INTERVAL_NS < float(np.median(intervals_ns)) <= MAX_INTERVAL_NS


def ticks_of(one: Named) -> NDArray[np.int64]:
    """Returns the number (N,) of images since the first one, including missing ones."""
    if one.numbers is None or not one.step:
        return np.arange(len(one.names))
    return (one.numbers - one.numbers[0]) // one.step


def ticks_of_pair(left: Named, right: Named) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
    """Returns the same for two cameras, (N,) and (M,), since the first image of both: equal numbers are pairs.

    None where the names do not determine it.
    """
    if left.numbers is None or right.numbers is None:
        return None
    common = np.intersect1d(left.numbers, right.numbers)
    both = np.union1d(left.numbers, right.numbers)
    unread = [one.unread for one in (left, right) if one.unread is not None]
    step = _step(np.unique(np.concatenate([both, *unread])))
    if len(common) < MIN_COMMON_SHARE * min(len(left.numbers), len(right.numbers)) or not step:
        return None
    return (left.numbers - both[0]) // step, (right.numbers - both[0]) // step


def _step(numbers: NDArray[np.int64]) -> int:
    steps = np.diff(numbers)
    if not len(steps):
        return 1
    step = int(np.gcd.reduce(steps))
    return step if (steps == step).mean() >= MIN_REGULAR_SHARE else 0


def _stamp(stem: str) -> int | None:
    """Returns the time [ns] since 1970; None without one."""
    match = _STAMP.search(stem)
    if match is None:
        return None
    seconds, fraction, whole = match.groups()
    return int(f"1{seconds}{fraction:0<9}" if whole is None else f"1{whole:0<18}")


def _date(stem: str) -> int | None:
    """Returns the time [ns] since 1970 of a date and a time of day; None without one."""
    match = _DATE.search(stem)
    if match is None:
        return None
    year, _, month, day, hour, _, minute, second, *fractions = match.groups()
    try:
        moment = datetime(*map(int, (year, month, day, hour, minute, second)), tzinfo=UTC)  # type: ignore[misc]
    except ValueError:
        return None
    return int(moment.timestamp()) * 10**9 + int(f"{fractions[0] or fractions[1] or '':0<9}")


def _before(name: str, stamp: Callable[[str], int | None]) -> str:
    """Returns the part of a name before its time."""
    return (_STAMP if stamp is _stamp else _DATE).sub("", Path(name).stem)


def _number(name: str) -> tuple[str, int]:
    """Returns the kind of an image, which is its name without the last number, and that number; -1 without one."""
    path = Path(name)
    match = _LAST_NUMBER.fullmatch(path.stem)
    kind = path.suffix.lower()
    return (path.stem + kind, -1) if match is None else (f"{match[1]}#{match[3]}{kind}", int(match[2]))


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
    if len(common) >= max(2, MIN_COMMON_SHARE * len(numbers[0])) and not parts:
        raise InputError(
            f"images of several kinds have the same numbers ({kinds[first][0]} and {kinds[second][0]}): give those of "
            "each camera, and depth images, a folder of their own"
        )


def _order(name: str) -> tuple[tuple[int, str], ...]:
    """Returns the sort key of a name, with numbers by value; every second part of the split is a number."""
    parts = re.split(r"([0-9]+)", name)
    return tuple((int(part), part) if i % 2 else (0, part) for i, part in enumerate(parts))
