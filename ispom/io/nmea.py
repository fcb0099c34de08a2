"""NMEA 0183: the GGA sentences of a GNSS receiver, with their checksums."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.rows import read_text
from ispom.io.values import number

DAY_NS = 86_400 * 10**9
"""Duration of a day."""
UERE_M = {1: 5.0, 2: 1.0, 3: 3.0, 4: 0.02, 5: 0.5}
"""Standard deviation of a position at HDOP 1 [m] by the quality of the fix: single, differential, precise, fixed and
floating ambiguities (usual figures of receivers' data sheets, as GGA holds none)."""
MAX_HDOP = 1e4
"""Largest HDOP: receivers write 99.99 or 9999 if it is unknown."""
VERTICAL_FACTOR = 1.5
"""Standard deviation of the height relative to the horizontal one, also from data sheets."""


@dataclass(frozen=True)
class Gga:
    """One fix."""

    time_of_day_ns: int
    """UTC."""
    latitude_deg: float
    longitude_deg: float
    height_m: float
    """Height above the ellipsoid: the sum of the height above the geoid and that of the geoid."""
    quality: int
    hdop: float
    satellites: int

    @property
    def sigma_m(self) -> Array:
        """(3,) standard deviations east, north and up [m]."""
        horizontal = max(self.hdop, 0.1) * UERE_M.get(self.quality, UERE_M[1])
        return horizontal * np.array([1.0, 1.0, VERTICAL_FACTOR])


def checksum(body: str) -> int:
    """Returns the XOR of the characters between $ and *."""
    value = 0
    for character in body:
        value ^= ord(character) & 0xFF
    return value


def gga_of(sentence: str) -> Gga | None:
    """Returns the fix of a sentence; None for a sentence of another kind, and for one without a fix.

    Raises ValueError with the reason for a damaged sentence.
    """
    text = sentence.strip()
    if not text.startswith("$") or text[3:6] != "GGA":
        return None
    body, star, check = text[1:].partition("*")
    if star:
        try:
            stated = int(check[:2], 16)
        except ValueError:
            raise ValueError(f"its checksum {check[:2]!r} is no hexadecimal number") from None
        if stated != checksum(body):
            raise ValueError(f"its checksum is {check[:2]}, its characters give {checksum(body):02X}")
    words = body.split(",")
    if len(words) < 12:
        raise ValueError(f"it has {len(words)} fields, not 15")
    if words[6] in ("", "0"):
        return None
    try:
        quality, satellites = int(words[6]), int(words[7] or 0)
        hdop = number("HDOP", words[8] or 1, 0, MAX_HDOP)
        height = number("height", words[9]) + number("geoid", words[11] or 0)
        latitude, longitude = _angle(words[2], words[3], 2, "NS"), _angle(words[4], words[5], 3, "EW")
        time_ns = _time_of_day_ns(words[1])
    except InputError as error:
        raise ValueError(str(error)) from None
    except (ValueError, IndexError):
        raise ValueError("a field is no number") from None
    if not (abs(latitude) <= 90 and abs(longitude) <= 180):
        raise ValueError("its position is no latitude and longitude")
    return Gga(time_ns, latitude, longitude, height, quality, hdop, satellites)


def read_gga(path: Path) -> tuple[list[int], list[Gga]]:
    """Returns the times since the first day's midnight [ns] and the fixes of a file, past midnights.

    Raises InputError that names the line of a damaged sentence, and for a file without any fix.
    """
    times_ns, fixes, day = list[int](), list[Gga](), 0
    for line, sentence in enumerate(read_text(path).splitlines(), 1):
        try:
            fix = gga_of(sentence)
        except ValueError as error:
            raise InputError(f"{path} line {line}: the GGA sentence is damaged ({error}): remove that line") from None
        if fix is None:
            continue
        if times_ns and fix.time_of_day_ns + day < times_ns[-1] - DAY_NS // 2:
            day += DAY_NS
        if times_ns and fix.time_of_day_ns + day <= times_ns[-1]:
            raise InputError(f"{path} line {line}: the fix is not after the one before: put the lines in order")
        times_ns.append(fix.time_of_day_ns + day)
        fixes.append(fix)
    if not fixes:
        raise InputError(f"{path} holds no GGA sentence with a fix: give the receiver's NMEA output")
    return times_ns, fixes


def _angle(word: str, side: str, digits: int, sides: str) -> float:
    """Returns the degrees of DDDMM.MMM and N, S, E or W."""
    if side not in tuple(sides) or not word[:digits].isdecimal():
        raise ValueError
    minutes = float(word[digits:])
    if not 0 <= minutes < 60:
        raise ValueError
    degrees = int(word[:digits]) + minutes / 60
    return degrees if side == sides[0] else -degrees


def _time_of_day_ns(word: str) -> int:
    hours, minutes, seconds = int(word[:2]), int(word[2:4]), float(word[4:])
    if not (0 <= hours < 24 and 0 <= minutes < 60 and 0 <= seconds < 61):
        raise ValueError
    return (hours * 3600 + minutes * 60) * 10**9 + round(seconds * 1e9)
