"""YAML files that hold a mapping, and the numbers in them: read with the place of every mistake."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ispom.errors import InputError
from ispom.io.rows import read_text


def read_mapping(path: Path) -> dict[Any, Any]:
    """The mapping of a YAML file, also of OpenCV; InputError where it is missing, malformed or no mapping."""
    text = read_text(path)
    if text.startswith("%YAML:"):  # OpenCV's directive, which is no YAML; the line stays, for counting
        text = "#" + text
    try:
        content = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        place = getattr(error, "problem_mark", None)
        where = f" line {place.line + 1}" if place else ""
        raise InputError(f"{path}{where} is not valid YAML: correct it") from None
    if not isinstance(content, dict):
        raise InputError(f"{path} holds no named values (name: value): give the right file")
    return content


def finite_numbers(path: Path, where: str, value: Any, counts: int | tuple[int, ...]) -> list[float]:
    """A list of one of `counts` finite numbers; InputError says where in the file it is not."""
    counts = (counts,) if isinstance(counts, int) else counts
    good = isinstance(value, list) and len(value) in counts
    if not good or not all(_is_number(v) for v in value):
        wanted = " or ".join(str(count) for count in counts)
        raise InputError(f"{path}: {where} needs {wanted} finite number(s): correct it")
    return [float(v) for v in value]


def _is_number(value: Any) -> bool:
    try:
        return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(float(value)))
    except OverflowError:
        return False
