"""Encodes a record as a JSON header and raw arrays, and decodes it. No code in it can run, and values stay exact.

The bytes come in two parts. The first has the header and the small arrays. The second has the arrays of tracks,
landmarks and residuals, which are nearly all of the bytes. It can be discarded; these arrays are empty then.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from functools import cache
from typing import Any, get_args, get_type_hints

import numpy as np

from ispom.types import ImageLines, Landmarks, Tracks, WorldLines

from .record import ExposureRecord

POINTS = (Tracks, Landmarks, ImageLines, WorldLines)
"""Classes whose arrays are in the second part, like those of the fields POINT_FIELDS."""
POINT_FIELDS = {"residuals_px", "segments", "spline"}
ALIGNMENT = 8


def encode(record: ExposureRecord) -> tuple[bytes, bytes]:
    """(header and small arrays, arrays of points)."""
    writer = _Writer()
    header = json.dumps(writer.tree(record, False), separators=(",", ":")).encode()
    return len(header).to_bytes(4, "little") + header + bytes(writer.parts[False]), bytes(writer.parts[True])


def decode(facts: bytes, points: bytes | None) -> ExposureRecord:
    """The record; thinned where its points are None."""
    end = 4 + int.from_bytes(facts[:4], "little")
    reader = _Reader({False: memoryview(facts)[end:], True: None if points is None else memoryview(points)})
    record = reader.value(json.loads(facts[4:end]))
    return record if points is not None else replace(record, thinned=True)


class _Writer:
    def __init__(self) -> None:
        self.parts = {False: bytearray(), True: bytearray()}
        self._seen: dict[int, int] = {}
        """By id of the object: the number of the dataclass value that it was."""

    def tree(self, value: Any, points: bool) -> Any:
        """The value as JSON's; arrays go to the part that `points` says."""
        if value is None or type(value) in (bool, int, float, str):
            return value
        if isinstance(value, np.ndarray):
            return self._array(value, points)
        if isinstance(value, np.generic):
            return value.item()
        if isinstance(value, tuple | list | frozenset):
            return [self.tree(item, points) for item in value]
        if (names := _field_names().get(type(value))) is not None:
            return self._fields(value, names, points or isinstance(value, POINTS))
        if isinstance(value, Enum):
            return {"enum": [type(value).__name__, value.value]}
        if isinstance(value, Mapping):
            return {"map": [[key, self.tree(item, points)] for key, item in value.items()]}
        raise TypeError(f"a record holds a {type(value).__name__}, which has no encoding")

    def _fields(self, value: Any, names: tuple[str, ...], points: bool) -> Any:
        if id(value) in self._seen:
            return {"same": self._seen[id(value)]}
        # An object gets its number after the objects inside it, because the reader builds them in this order.
        found = [self.tree(getattr(value, name), points or name in POINT_FIELDS) for name in names]
        self._seen[id(value)] = len(self._seen)
        return {"class": type(value).__name__, "is": found}

    def _array(self, array: np.ndarray, points: bool) -> Any:
        part = self.parts[points]
        part += bytes(-len(part) % ALIGNMENT)
        start = len(part)
        part += np.ascontiguousarray(array).tobytes()
        return {"array": [array.dtype.str, list(array.shape), start, int(points)]}


class _Reader:
    def __init__(self, parts: Mapping[bool, memoryview | None]) -> None:
        self._parts = parts
        self._seen: list[Any] = []

    def value(self, tree: Any) -> Any:
        match tree:
            case list():
                return tuple(self.value(item) for item in tree)
            case {"array": [kind, shape, start, points]}:
                return self._array(np.dtype(kind), shape, start, bool(points))
            case {"enum": [name, value]}:
                return _classes()[name](value)
            case {"map": items}:
                return {key: self.value(item) for key, item in items}
            case {"same": number}:
                return self._seen[number]
            case {"class": name, "is": found}:
                made = _classes()[name](*(self.value(item) for item in found))
                self._seen.append(made)
                return made
            case _:
                return tree

    def _array(self, kind: np.dtype, shape: list[int], start: int, points: bool) -> np.ndarray:
        part = self._parts[points]
        if part is None:
            return np.zeros((0, *shape[1:]), kind)
        return np.frombuffer(part, kind, int(np.prod(shape)), start).reshape(shape)


@cache
def _classes() -> dict[str, type]:
    """By name: the dataclasses and enumerations that a record may hold, as its fields' types say."""
    found: dict[str, type] = {}
    waiting: list[Any] = [ExposureRecord]
    while waiting:
        kind = waiting.pop()
        waiting += get_args(kind)
        if isinstance(kind, type) and kind.__name__ not in found and (is_dataclass(kind) or issubclass(kind, Enum)):
            found[kind.__name__] = kind
            waiting += get_type_hints(kind).values() if is_dataclass(kind) else ()
    return found


@cache
def _field_names() -> dict[type, tuple[str, ...]]:
    """Returns the field names of the dataclasses. Looking them up for each value would take longer than writing it."""
    return {kind: tuple(f.name for f in fields(kind)) for kind in _classes().values() if is_dataclass(kind)}
