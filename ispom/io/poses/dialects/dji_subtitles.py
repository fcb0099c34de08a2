"""Subtitles of DJI's drones (`DJI_0007.SRT`): `[latitude: ..] [longitude: ..] [rel_alt: .. abs_alt: ..]` for each
image or second.

Positions are metres east, north and up of the first one, on the ellipsoid WGS 84; heights are abs_alt, or else
rel_alt [m]. Times are the beginnings of the subtitles, from the film's start. Older drones write
`GPS(longitude,latitude,height)`, in which the height is a number of satellites in some: it is not used. Rotations are
not in the file. Source: files of DJI Mini and Mavic; DJI has published no description.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import PoseDialect, TrajectoryFile, of_quaternions
from ispom.io.poses.dialects.geographic import east_north_up

TITLE = "DJI subtitles"
_START = re.compile(r"(\d{1,3}):(\d\d):(\d\d)[,.](\d{3})\s*-->")
_NUMBER = r"\s*:?\s*(-?\d{1,6}(?:\.\d{1,12})?)"
_PLACE = re.compile(rf"latitude{_NUMBER}\s*\]?\s*\[?\s*longt?itude{_NUMBER}", re.IGNORECASE)
_HEIGHT = re.compile(rf"(abs_alt|rel_alt|altitude){_NUMBER}", re.IGNORECASE)
_OLD = re.compile(r"GPS\s*\(\s*(-?\d{1,3}\.\d{1,12})\s*,\s*(-?\d{1,2}\.\d{1,12})")


def _recognises(content: PoseContent) -> bool:
    if not content.is_text or content.suffix != ".srt":
        return False
    head = content.head.decode("utf-8", "replace")
    return bool(_START.search(head) and (_PLACE.search(head) or _OLD.search(head)))


def _read(content: PoseContent, times_ns: NDArray[np.int64] | None) -> TrajectoryFile:
    path, time_ns = content.path, None
    found: dict[int, tuple[int, list[float]]] = {}
    for line, text in enumerate(content.text.splitlines(), 1):
        if (start := _START.search(text)) is not None:
            hours, minutes, seconds, millis = map(int, start.groups())
            time_ns = ((hours * 60 + minutes) * 60 + seconds) * 10**9 + millis * 10**6
        place, old = _PLACE.search(text), _OLD.search(text)
        if time_ns is None or (place is None and old is None):
            continue
        heights = {name.lower(): float(value) for name, value in _HEIGHT.findall(text)}
        height = heights.get("abs_alt", heights.get("rel_alt", heights.get("altitude", 0.0)))
        latitude, longitude = map(float, place.groups() if place else (old.groups()[::-1] if old else ()))
        if abs(latitude) > 90 or abs(longitude) > 180:
            raise InputError(f"{path} line {line}: it is no latitude and longitude in degrees: correct it")
        if latitude or longitude:  # both are 0 before the first fix
            found[time_ns] = (line, [latitude, longitude, height])
    if not found:
        raise InputError(f"{path} has no position with a fix: give a flight with GNSS")
    rows = [(found[t][0], [str(t)]) for t in sorted(found)]
    places = np.array([found[t][1] for t in sorted(found)])
    times = np.array(sorted(found), np.int64)
    xyzw = np.tile([0.0, 0, 0, 1], (len(times), 1))
    trajectory = of_quaternions(content, rows, times, east_north_up(places), xyzw)
    note = f"{path}: positions are metres east, north and up of the first one; it has no rotations"
    return TrajectoryFile(path, TITLE, trajectory, notes=(note,), has_rotations=False)


DIALECT = PoseDialect(
    "dji_subtitles",
    TITLE,
    "DJI_*.SRT",
    "text",
    "subtitles with a latitude and a longitude",
    _recognises,
    _read,
)
