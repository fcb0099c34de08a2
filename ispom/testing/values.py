"""Digests of values of any kind, to compare them bit by bit, and their depth."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import partial
from hashlib import blake2b
from typing import Any

import numpy as np

TIMES = frozenset({"seconds"})
"""The fields of a Step that differ between runs."""


def digest(value: Any, without: frozenset[str] = frozenset()) -> bytes:
    """Returns 16 bytes that differ where anything inside differs, except fields named in `without`.

    Raises TypeError for what cannot be pickled, RecursionError for what is nested endlessly.
    """
    hashed = blake2b(digest_size=16)
    _feed(hashed, value, without)
    return hashed.digest()


def depth(value: Any) -> int:
    """Returns how deep values are nested in others."""
    deepest, seen, waiting = 0, set[int](), [(value, 1)]
    while waiting:
        inner, level = waiting.pop()
        deepest = max(deepest, level)
        if id(inner) not in seen:
            seen.add(id(inner))
            waiting += [(content, level + 1) for content in _contents(inner)]
    return deepest


def _contents(value: Any) -> Iterable[Any]:
    """Returns the direct contents of the known kinds of values."""
    if is_dataclass(value) and not isinstance(value, type):
        return [getattr(value, f.name) for f in fields(value)]
    if isinstance(value, Mapping):
        return value.values()
    if isinstance(value, partial):
        return (*value.args, *value.keywords.values())
    return value if isinstance(value, tuple | list | set | frozenset) else ()


def _feed(found: Any, value: Any, without: frozenset[str]) -> None:
    found.update(f"{type(value).__module__}.{type(value).__qualname__}:".encode())
    if isinstance(value, np.ndarray) and value.dtype != object:
        found.update(f"{value.dtype.str}{value.shape}".encode() + np.ascontiguousarray(value).tobytes())
    elif isinstance(value, np.generic):
        found.update(value.tobytes())
    elif isinstance(value, Enum):
        found.update(value.name.encode())
    elif isinstance(value, float):
        found.update(struct.pack("<d", value))
    elif value is None or isinstance(value, bool | int | str | bytes):
        found.update(f"{value!r};".encode())
    elif is_dataclass(value) and not isinstance(value, type):
        for field in fields(value):
            if field.name not in without:
                found.update(f"{field.name}=".encode())
                _feed(found, getattr(value, field.name), without)
    elif isinstance(value, set | frozenset):
        found.update(b"".join(sorted(digest(item, without) for item in value)))
    elif isinstance(value, Mapping):
        _feed(found, tuple(value.items()), without)
    elif isinstance(value, tuple | list):
        found.update(f"{len(value)};".encode())
        for item in value:
            _feed(found, item, without)
    elif name := getattr(value, "__qualname__", None):  # functions and classes compare by name
        found.update(f"{value.__module__}.{name}".encode())
    else:
        other: Any = value
        reduced = other.__reduce_ex__(4)
        _feed(found, reduced if isinstance(reduced, str) else tuple(map(_listed, reduced)), without)


def _listed(part: Any) -> Any:
    """Returns iterators of a reduced value as lists."""
    return list(part) if hasattr(part, "__next__") else part
