"""The content of a file of poses: text, rows of words, the names of a header, JSON."""

from __future__ import annotations

import json
import math
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.files import is_folder, read_bytes, read_head
from ispom.io.pose_table import Columns, Roles, header_columns, header_roles, split_line
from ispom.io.rows import Row, read_text
from ispom.io.values import LARGEST

LARGEST_BINARY = 1 << 30
"""Largest size of a binary file: an images.bin of COLMAP has 24 bytes for each point of each image."""
HEAD_BYTES = 4096
"""Number of bytes of `head`."""
SAMPLE_ROWS = 50
"""Number of first rows by which a dialect is recognised."""
MAX_DEPTH = 8
"""Largest nesting depth of JSON values."""


class PoseContent:
    """The content of a file or folder. Each form of it is made once, on demand."""

    def __init__(self, path: Path, topic: str = "") -> None:
        """`topic` is that of a bag, if one is chosen."""
        self.path, self.topic = path, topic

    @property
    def suffix(self) -> str:
        """Suffix of the file's name, in lower case."""
        return self.path.suffix.lower()

    @cached_property
    def is_folder(self) -> bool:
        return is_folder(self.path)

    @cached_property
    def head(self) -> bytes:
        """The first bytes of a file; empty for a folder."""
        return b"" if self.is_folder else read_head(self.path, HEAD_BYTES)

    @cached_property
    def is_text(self) -> bool:
        return not self.is_folder and b"\0" not in self.head

    @cached_property
    def binary(self) -> bytes:
        """All bytes. Raises InputError for a file larger than LARGEST_BINARY."""
        return read_bytes(self.path, LARGEST_BINARY)

    @cached_property
    def text(self) -> str:
        """The text. Raises InputError where it is not in UTF-8."""
        return read_text(self.path)

    @cached_property
    def rows(self) -> list[Row]:
        """The words of each line without comments (# or %), separated by semicolons, or else commas, or else spaces."""
        lines = enumerate(self.text.splitlines(), 1) if self.is_text else ()
        rows = ((line, split_line(text.strip())) for line, text in lines if not text.lstrip().startswith(("#", "%")))
        return [(line, words) for line, words in rows if words]

    @cached_property
    def sample(self) -> list[list[float]]:
        """The numbers of the first rows that contain only numbers, and as many as the first such row. One line of words
        may be before them, as a header; with more the sample is empty."""
        found: list[list[float]] = []
        for _, words in self.rows[: SAMPLE_ROWS + 1]:
            numbers = _numbers(words)
            if numbers is not None and (not found or len(numbers) == len(found[0])):
                found.append(numbers)
            elif not found and (words is not self.rows[0][1] or any(_numbers([word]) for word in words)):
                return []
        return found

    @property
    def width(self) -> int:
        """Number of numbers in a row; 0 where the first rows are not numbers."""
        return len(self.sample[0]) if self.sample else 0

    @cached_property
    def spaced(self) -> bool:
        """Whether the words of rows are separated by spaces or tabs."""
        return not any({",", ";"} & set(self.text.splitlines()[line - 1]) for line, _ in self.rows[:2])

    @cached_property
    def columns(self) -> Columns | None:
        """The columns that a header names, of poses with times and quaternions."""
        return self._header[0]

    @property
    def header_fault(self) -> InputError | None:
        """The error of an invalid header."""
        return self._header[1]

    @cached_property
    def roles(self) -> Roles | None:
        """The roles of the columns, from a header that names positions."""
        return header_roles(self.path) if self.is_text else None

    @cached_property
    def data(self) -> list[Row]:
        """The rows without a header."""
        first = next((i for i, (_, words) in enumerate(self.rows) if _numbers(words[:1]) is not None), len(self.rows))
        return self.rows[first:]

    @cached_property
    def comments(self) -> str:
        """The comments at the beginning, in lower case."""
        lines = self.text.splitlines()[:20] if self.is_text else []
        return "\n".join(line.strip().lower() for line in lines if line.lstrip().startswith(("#", "%")))

    @cached_property
    def objects(self) -> list[tuple[int, Any]]:
        """The values of JSON lines with their line numbers, or those of one JSON text, with 0; empty without JSON."""
        if not self.is_text or self.head.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] not in (b"{", b"["):
            return []
        if (whole := _json(self.text)) is not None:
            return [(0, whole)]
        lines = [(n, text) for n, text in enumerate(self.text.splitlines(), 1) if text.strip()]
        if not lines or _json(lines[0][1]) is None:
            return []
        found = [(n, _json(text)) for n, text in lines]
        bad = next((n for n, values in found if values is None), None)
        if bad is not None:
            raise InputError(f"{self.path} line {bad} is not valid JSON: correct it")
        return found

    @cached_property
    def _header(self) -> tuple[Columns | None, InputError | None]:
        if not self.is_text:
            return None, None
        try:
            return header_columns(self.path), None
        except InputError as fault:
            return None, fault

    def unit_length(self, first: int) -> bool:
        """Checks that the four numbers from column `first` are a unit quaternion (to 1 %) in all rows of the sample."""
        values = np.array(self.sample)
        if not len(values) or values.shape[1] < first + 4:
            return False
        return bool((abs(np.linalg.norm(values[:, first : first + 4], axis=1) - 1) <= 0.01).all())

    def column(self, index: int) -> Array:
        """Returns a column of the sample (N,)."""
        return np.array([row[index] for row in self.sample])


def _numbers(words: list[str]) -> list[float] | None:
    try:
        found = [float(word) for word in words]
    except ValueError:
        return None
    return [value if abs(value) <= LARGEST else 0.0 for value in found]  # the reader reports too large values


def _json(text: str) -> Any:
    """Returns the values, numbers as words; None for other texts than JSON, and for deeply nested values."""
    try:
        values = json.loads(text, parse_float=str, parse_int=str, parse_constant=str)
    except (ValueError, RecursionError):
        return None
    return values if isinstance(values, dict | list) and _depth(values) <= MAX_DEPTH else None


def _depth(values: Any, most: int = MAX_DEPTH) -> float:
    if not isinstance(values, dict | list) or not values:
        return 1
    if most < 1:
        return math.inf
    return 1 + max(_depth(value, most - 1) for value in (values.values() if isinstance(values, dict) else values))
