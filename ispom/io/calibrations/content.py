"""The content of a calibration file, as text, values of YAML or JSON, XML, and rows of numbers."""

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

MAX_FILE_BYTES = 16 << 20
"""Largest size of a file: a transforms.json of nerfstudio has 0.6 kB for each image, so this is 28,000 images."""
MAX_XML_ELEMENTS = 50_000
"""Largest number of elements of an XML file."""
MAX_ROWS, MAX_NUMBERS = 16, 64
"""Largest size of a text of numbers: a calibration has a few, a trajectory many."""
_BRACKETS = str.maketrans(dict.fromkeys("[](){},;", " "))


class Content:
    """The content of a file. Each form of it is made once, on demand, and is None if the file does not have that
    form."""

    def __init__(self, path: Path, data: bytes) -> None:
        self.path, self.data = path, data

    @classmethod
    def of(cls, path: Path) -> Content:
        """Reads a file. Raises InputError where it is missing, or too large for a calibration."""
        return cls(path, read_bytes(path, MAX_FILE_BYTES))

    @property
    def suffix(self) -> str:
        """Suffix of the file's name, in lower case."""
        return self.path.suffix.lower()

    @cached_property
    def text(self) -> str | None:
        """The text in UTF-8, or in UTF-16 with a byte-order mark, as PowerShell writes a program's output."""
        wide = self.data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        try:
            text = self.data.decode("utf-16" if wide else "utf-8-sig")
        except UnicodeDecodeError:
            return None
        return None if "\0" in text else text

    @cached_property
    def words(self) -> str:
        """The text; empty where there is none."""
        return self.text or ""

    @cached_property
    def values(self) -> Any:
        """The values of JSON or YAML."""
        return self._parsed[0]

    @property
    def fault(self) -> InputError | None:
        """The error in the YAML or JSON."""
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
        """The root of an XML file; None with entities, which can expand to billions of letters."""
        text = self.words.lstrip()
        if not text.startswith("<") or "<!" in text.replace("<!--", ""):
            return None
        try:
            root = ElementTree.fromstring(text.encode())
        except (ElementTree.ParseError, ValueError, LookupError, RecursionError):
            return None
        return (
            root
            if sum(1 for _ in zip(range(MAX_XML_ELEMENTS + 1), root.iter(), strict=False)) <= MAX_XML_ELEMENTS
            else None
        )

    @cached_property
    def rows(self) -> list[list[float]] | None:
        """The numbers of each line, of a text of only numbers, brackets, separators and comments (#, %, //)."""
        if not 0 < len(self.words) <= 64 * MAX_NUMBERS:
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
            if not all(abs(value) <= LARGEST for value in row):  # also for NaN
                return None
            found += [row] if row else []
        few = len(found) <= MAX_ROWS and sum(map(len, found)) <= MAX_NUMBERS
        return found if found and few else None

    @cached_property
    def matrix(self) -> Array | None:
        """The rows as a matrix, where they have one length."""
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
    """Returns the nesting depth of values; any number above `most` for a larger depth."""
    if most < 0 or not isinstance(values, dict | list) or not values:
        return 1
    inner = values.values() if isinstance(values, dict) else values
    return 1 + max(_depth(value, most - 1) for value in inner)
