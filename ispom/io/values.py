"""A number within bounds and a name, as every reader of files wants them."""

from __future__ import annotations

import math
import re
from decimal import Decimal, InvalidOperation
from typing import Any

from ispom.errors import InputError
from ispom.types.rig import POSE_PREFIX, SIGMA_SUFFIX

LARGEST = 1e15
"""No length, angle or intrinsic is larger; squares and cubes of it are still numbers."""
MAX_TIME_S = 4_600_000_000
"""No time is farther from zero (in 2115, counted since 1970): any two have a difference in 64 bits of nanoseconds."""

NAME = re.compile(r"[a-z][a-z0-9_]{0,30}")
"""Small letters, digits and _, a letter first: what is a name in rigs, methods' frames, columns and options."""
CAMERAS = ("video", "left", "right")
FRAMES = frozenset({"rig", "world", "body", "board"})
"""Coordinate frames that are no sensors."""
RESERVED = FRAMES | {*CAMERAS, "self", "truth"}


def number(where: str, value: Any, least: float = -LARGEST, most: float = LARGEST) -> float:
    """Returns a number, or what the words of one say. Raises InputError, which begins with `where`, for what is no
    finite number, and for one outside of its bounds."""
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
    """Returns the time [ns] that a decimal number of units says, exactly. Raises InputError, which begins with
    `where`."""
    try:
        value = Decimal(word)
    except InvalidOperation:
        value = Decimal("NaN")
    if not value.is_finite() or value.copy_abs() > MAX_TIME_S * 10**9 // unit_ns:
        unit = " in seconds" if unit_ns == 10**9 else ""
        raise InputError(f"{where}: '{word[:40]}' is not a time{unit}: correct that line")
    return int((value * unit_ns).to_integral_value())


def nanoseconds(word: str) -> int | None:
    """Returns a time of whole nanoseconds since 1970, written in digits only; None for other words, and for one that is
    too late."""
    digits = word.isascii() and word.isdigit() and len(word) <= 19
    return int(word) if digits and int(word) <= MAX_TIME_S * 10**9 else None


def is_name(word: Any) -> bool:
    """Checks for small letters, digits and _, a letter first."""
    return isinstance(word, str) and NAME.fullmatch(word) is not None


def is_sensor_name(word: Any) -> bool:
    """Checks for a name that a sensor may have which is none of the usual cameras: not that of a coordinate frame, nor
    of an entry that a rig.yaml has for them."""
    entry = is_name(word) and (word.startswith(POSE_PREFIX) or word.endswith(SIGMA_SUFFIX))
    return is_name(word) and word not in RESERVED and not entry


def sensor_name(where: str, word: Any) -> str:
    """Returns a name as `is_sensor_name` wants it. Raises InputError, which begins with `where`, for another one."""
    if not is_sensor_name(word):
        taken = f"{', '.join(sorted(RESERVED))}, {POSE_PREFIX}... and ...{SIGMA_SUFFIX} have other meanings"
        raise InputError(
            f"{where}: {str(word)[:40]!r} is no name of a sensor: use small letters, digits and _, a letter first "
            f"({taken})"
        )
    return word
