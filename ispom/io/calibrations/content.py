"""What a file holds, as the dialects of calibrations look at it: text, values of YAML or JSON, XML, rows of numbers."""

from __future__ import annotations

import codecs
import json
import re
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.files import read_bytes
from ispom.io.mapping import MAX_BYTES, MAX_DEPTH, parse_yaml, yaml_of_opencv
from ispom.io.values import LARGEST

LARGEST_FILE = 16 << 20
"""A transforms.json of nerfstudio has 0.6 kB for each of its images."""
MOST_ELEMENTS = 50_000
"""Of an XML file."""
MOST_ROWS, MOST_NUMBERS = 16, 64
"""Of a text of numbers: a calibration has a few, a trajectory many."""
_BRACKETS = str.maketrans(dict.fromkeys("[](){},;", " "))


class Content:
    """The content of a file; each view of it is made once, when it is needed, and is None where it has no such view."""

    def __init__(self, path: Path, data: bytes) -> None:
        self.path, self.data = path, data

    @classmethod
    def of(cls, path: Path) -> Content:
        """Reads a file. Raises InputError where it is missing, or too large for a calibration."""
        return cls(path, read_bytes(path, LARGEST_FILE))

    @property
    def suffix(self) -> str:
        """In lower case."""
        return self.path.suffix.lower()

    @cached_property
    def text(self) -> str | None:
        """In UTF-8, or in UTF-16 with its mark, as PowerShell writes what a program printed."""
        wide = self.data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        try:
            text = self.data.decode("utf-16" if wide else "utf-8-sig")
        except UnicodeDecodeError:
            return None
        return None if "\0" in text else text

    @cached_property
    def words(self) -> str:
        """The text, or nothing."""
        return self.text or ""

    @cached_property
    def values(self) -> Any:
        """The values of JSON or YAML."""
        return self._parsed[0]

    @property
    def fault(self) -> InputError | None:
        """What is wrong with the YAML or JSON."""
        return self._parsed[1]

    @cached_property
    def mapping(self) -> dict[Any, Any]:
        """The named values of YAML or JSON; empty where it has none."""
        return self.values if isinstance(self.values, dict) else {}

    @cached_property
    def keys(self) -> frozenset[str]:
        """Names of the values at the top."""
        return frozenset(key for key in self.mapping if isinstance(key, str))

    @cached_property
    def xml(self) -> ElementTree.Element | None:
        """The root of an XML file without entities, which may stand for billions of letters."""
        text = self.words.lstrip()
        if not text.startswith("<") or "<!" in text.replace("<!--", ""):
            return None
        try:
            root = ElementTree.fromstring(text.encode())
        except (ElementTree.ParseError, ValueError, LookupError, RecursionError):
            return None
        return (
            root if sum(1 for _ in zip(range(MOST_ELEMENTS + 1), root.iter(), strict=False)) <= MOST_ELEMENTS else None
        )

    @cached_property
    def rows(self) -> list[list[float]] | None:
        """The numbers of each line of a text that has nothing else but brackets, separators and comments (#, %, //)."""
        if not 0 < len(self.words) <= 64 * MOST_NUMBERS:
            return None
        if any(self.words.count(one) != self.words.count(other) for one, other in ("[]", "()", "{}")):
            return None  # a part of something else
        found: list[list[float]] = []
        for line in self.words.splitlines():
            words = re.split(r"#|%|//", line)[0].translate(_BRACKETS).split()
            try:
                row = [float(word) for word in words]
            except ValueError:
                return None
            if not all(abs(value) <= LARGEST for value in row):  # NaN is not either
                return None
            found += [row] if row else []
        few = len(found) <= MOST_ROWS and sum(map(len, found)) <= MOST_NUMBERS
        return found if found and few else None

    @cached_property
    def matrix(self) -> Array | None:
        """Rows of numbers of one length, as a matrix."""
        if self.rows is None or len(set(map(len, self.rows))) != 1:
            return None
        return np.array(self.rows)

    @cached_property
    def _parsed(self) -> tuple[Any, InputError | None]:
        text = self.text
        if text is None:
            return None, None
        if text.lstrip()[:1] in ("{", "["):
            try:
                return _of_json(self.path, text), None
            except InputError as fault:
                if self.suffix == ".json":
                    return None, fault
        if len(self.data) > MAX_BYTES:
            return None, InputError(f"{self.path} is larger than {MAX_BYTES >> 10} kB, more than such a file holds")
        try:
            return parse_yaml(self.path, yaml_of_opencv(text)), None
        except InputError as fault:
            return None, fault


def _of_json(path: Path, text: str) -> Any:
    try:
        values = json.loads(text, object_pairs_hook=lambda pairs: _without_repeats(path, pairs))
    except json.JSONDecodeError as error:
        raise InputError(f"{path} line {error.lineno} is not valid JSON: correct it") from None
    except (ValueError, RecursionError):  # an integer of too many digits; lists in lists in lists
        raise InputError(f"{path} is not valid JSON: correct it") from None
    if _depth(values, MAX_DEPTH) > MAX_DEPTH:
        raise InputError(f"{path} nests too deep: correct it")
    return values


def _without_repeats(path: Path, pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"{path}: {twice} is given twice: remove one")
    return found


def _depth(values: Any, most: int) -> int:
    """Returns how deep values nest; more than `most` where they nest deeper than that."""
    if most < 0 or not isinstance(values, dict | list) or not values:
        return 1
    inner = values.values() if isinstance(values, dict) else values
    return 1 + max(_depth(value, most - 1) for value in inner)
