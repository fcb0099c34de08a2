"""YAML files (also JSON, and OpenCV's) with a mapping, and the numbers in them; errors name their position."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from ispom.errors import InputError, counted
from ispom.io.rows import read_text
from ispom.io.values import LARGEST, number

MAX_BYTES = 256 << 10
"""Largest size of a file: calibrations have a few kB."""
MAX_DIGITS = 100
"""Largest number of digits of an integer; Python raises ValueError for integers of more than 4300."""
MAX_VALUES, MAX_DEPTH = 20_000, 30
"""Largest number of values, and nesting depth, of a file with its aliases expanded: a short file of nested aliases can
expand to billions."""

_EXPONENT = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+")


class _Loader(yaml.SafeLoader):
    """A loader for OpenCV's tags, whose matrices are mappings with rows, cols, dt and data."""


for _tag in ("opencv-matrix", "opencv-nd-matrix"):
    _Loader.add_constructor(f"tag:yaml.org,2002:{_tag}", yaml.SafeLoader.construct_yaml_map)


def read_mapping(path: Path) -> dict[Any, Any]:
    """Returns the mapping of a YAML file, also of OpenCV. Raises InputError where it is missing, malformed or no
    mapping."""
    return mapping_of(path, read_text(path, MAX_BYTES))


def mapping_of(path: Path, text: str) -> dict[Any, Any]:
    """Returns the mapping of the text of such a file. Raises InputError as `read_mapping`."""
    content = parse_yaml(path, yaml_of_opencv(text))
    if not isinstance(content, dict):
        raise InputError(f"{path} holds no named values (name: value): give the right file")
    return content


def yaml_of_opencv(text: str) -> str:
    """Returns the text with OpenCV's directive, which is no YAML, as a comment; the line stays, for counting."""
    return "#" + text if text.startswith("%YAML:") else text


def parse_yaml(where: Path | str, text: str) -> Any:
    """Returns the values of an untrusted YAML text.

    Raises InputError, which begins with `where`, for a text that is malformed or has more than MAX_VALUES values.
    """
    try:
        return _loaded(where, text)
    except InputError:
        raise
    except Exception as error:  # its constructors raise KeyError, IndexError and others on values of a wrong tag
        place = getattr(error, "problem_mark", None)
        line = f" line {place.line + 1}" if place else ""
        raise InputError(f"{where}{line} is not valid YAML: correct it") from None


def _loaded(path: Path | str, text: str) -> Any:
    loader = _Loader(text)
    try:
        root = loader.get_single_node()
        if root is None:
            return None
        if _written_out(path, root, 0, {}) > MAX_VALUES:
            raise InputError(
                f"{path} holds more than {MAX_VALUES} values (aliases written out) or nests too deep: correct it"
            )
        return loader.construct_document(root)
    finally:
        loader.dispose()


def _written_out(path: Path | str, node: Node, depth: int, known: dict[int, int]) -> int:
    """Returns the number of values in a node; more than MAX_VALUES where it is too deep, or contains itself.

    Raises InputError where a name is given twice.
    """
    if depth > MAX_DEPTH:
        return MAX_VALUES + 1
    if id(node) not in known:
        known[id(node)] = MAX_VALUES + 1  # while it is counted, so that a node that contains itself is refused
        inner: list[Node] = []
        if isinstance(node, MappingNode):
            _require_once(path, node)
            inner = [part for pair in node.value for part in pair]
        elif isinstance(node, SequenceNode):
            inner = node.value
        elif isinstance(node, ScalarNode) and node.tag.endswith(":int") and len(node.value) > MAX_DIGITS:
            raise ValueError("too many digits: Python refuses to print such an integer")
        known[id(node)] = min(MAX_VALUES + 1, 1 + sum(_written_out(path, part, depth + 1, known) for part in inner))
    return known[id(node)]


def _require_once(path: Path | str, node: MappingNode) -> None:
    names: set[tuple[str, str]] = set()
    for key, _ in node.value:
        if isinstance(key, ScalarNode) and not key.tag.endswith(":merge"):
            if (key.tag, key.value) in names:
                raise InputError(f"{path} line {key.start_mark.line + 1}: {key.value} is given twice: remove one")
            names.add((key.tag, key.value))


def finite_numbers(
    path: Path,
    where: str,
    value: Any,
    counts: int | tuple[int, ...],
    least: float = -LARGEST,
    most: float = LARGEST,
) -> list[float]:
    """Returns a list of one of `counts` finite numbers within bounds. Raises InputError that names the position where
    it is not."""
    counts = (counts,) if isinstance(counts, int) else counts
    good = isinstance(value, list) and len(value) in counts
    if not good or not all(_is_number(v) for v in value):
        expected = " or ".join([*map(str, counts[:-1]), counted(counts[-1], "finite number")])
        raise InputError(f"{path}: {where} needs {expected}: correct it")
    return [number(f"{path}: {where}", v, least, most) for v in value]


def _is_number(value: Any) -> bool:
    if isinstance(value, str):  # an exponent without a point or a sign, as programs write it, is a word in YAML 1.1
        value = float(value) if _EXPONENT.fullmatch(value) else value
    try:
        return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(float(value)))
    except OverflowError:
        return False
