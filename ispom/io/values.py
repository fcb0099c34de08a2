"""Checks of numbers, times and names in files."""

from __future__ import annotations

import math
import re
from decimal import Decimal, InvalidOperation
from typing import Any

from ispom.errors import InputError
from ispom.types.rig import POSE_PREFIX, SIGMA_SUFFIX

LARGEST = 1e15
"""Largest magnitude of a length, angle or intrinsic: its square and cube are still finite."""
MIN_SIGMA, MAX_SIGMA = 1e-12, 1e9
"""Range of standard deviations, whose squares and inverse squares are still finite."""
MAX_TIME_S = 4_600_000_000
"""Largest magnitude of a time (the year 2115, since 1970): differences of times fit into 64 bits of nanoseconds."""

NAME = re.compile(r"[a-z][a-z0-9_]{0,30}")
"""Names in rigs, frames of methods, columns and options: small letters, digits and _, a letter first."""
CAMERAS = ("video", "left", "right")
FRAMES = frozenset({"rig", "world", "body", "board"})
"""Coordinate frames other than those of sensors."""
RESERVED = FRAMES | {*CAMERAS, "self", "truth"}


def number(where: str, value: Any, least: float = -LARGEST, most: float = LARGEST) -> float:
    """Returns a number, or the number that a word stands for. Raises InputError, which begins with `where`, where it is
    not finite, or outside of its bounds."""
    try:
        found = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        found = math.nan
    if not math.isfinite(found):
        raise InputError(f"{where}: '{str(value)[:40]}' is not a finite number: correct it")
    if not least <= found <= most:
        if (least, most) == (-LARGEST, LARGEST):
            raise InputError(f"{where}: '{str(value)[:40]}' is too large for what it says: correct it")
        raise InputError(f"{where} is {found:g}, give a value from {least:g} to {most:g}")
    return found


def time_ns(where: str, word: str, unit_ns: int = 10**9) -> int:
    """Converts a decimal number of units to a time [ns], exactly. Raises InputError, which begins with `where`."""
    try:
        value = Decimal(word)
    except InvalidOperation:
        value = Decimal("NaN")
    if not value.is_finite() or value.copy_abs() > MAX_TIME_S * 10**9 // unit_ns:
        unit = " in seconds" if unit_ns == 10**9 else ""
        raise InputError(f"{where}: '{word[:40]}' is not a time{unit}: correct that line")
    return int((value * unit_ns).to_integral_value())


def nanoseconds(word: str) -> int | None:
    """Returns the time of a word of digits, whole nanoseconds since 1970; None for other words, and above
    MAX_TIME_S."""
    digits = word.isascii() and word.isdigit() and len(word) <= 19
    return int(word) if digits and int(word) <= MAX_TIME_S * 10**9 else None


def is_name(word: Any) -> bool:
    """Checks for small letters, digits and _, a letter first."""
    return isinstance(word, str) and NAME.fullmatch(word) is not None


def is_sensor_name(word: Any) -> bool:
    """Checks for a name that a sensor other than the usual cameras may have: not that of a coordinate frame, nor of an
    entry of a rig.yaml for these cameras."""
    entry = is_name(word) and (word.startswith(POSE_PREFIX) or word.endswith(SIGMA_SUFFIX))
    return is_name(word) and word not in RESERVED and not entry


def sensor_name(where: str, word: Any) -> str:
    """Returns a valid name (see `is_sensor_name`). Raises InputError, which begins with `where`, for another one."""
    if not is_sensor_name(word):
        taken = f"{', '.join(sorted(RESERVED))}, {POSE_PREFIX}... and ...{SIGMA_SUFFIX} have other meanings"
        raise InputError(
            f"{where}: {str(word)[:40]!r} is no name of a sensor: use small letters, digits and _, a letter first "
            f"({taken})"
        )
    return word
