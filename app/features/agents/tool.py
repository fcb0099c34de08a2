"""What a tool for agents is, and the tools of all features, found by listing.

A feature that offers tools has a module `tools` with `TOOLS`. Nothing else is edited for a new one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import msgspec

from ispom.errors import InputError

from ...engine.outputs import json_of
from ...session.registry import modules

MOST_ROWS = 200
"""Rows of one answer: with a dozen numbers each, some 20 kB."""
DIGITS = 6
"""Significant digits of a number in an answer."""


@dataclass(frozen=True)
class Tool:
    """A function that an agent may call by its name."""

    function: Callable[..., Any]
    """Its first parameter is the `AgentSession`; the others are what the agent gives. `Annotated[int, "..."]` says what
    a parameter means, and the docstring what the answer is. It returns a dict of JSON values, or a `Picture`.
    InputError is an answer, too: one sentence that says what to do."""
    changes: bool = False
    """Whether it changes anything that somebody may miss: refused unless changes are allowed."""
    moves: bool = False
    """Whether another frame, branch or source is shown afterwards: refused where a person looks at the same session."""

    @property
    def name(self) -> str:
        return self.function.__name__


@dataclass(frozen=True)
class Picture:
    """An image as an answer."""

    data: bytes
    format: Literal["png", "jpeg"] = "png"


def tools() -> dict[str, Tool]:
    """The tools of all features by name, in the order of the features' names. ValueError for two of one name."""
    found: dict[str, Tool] = {}
    for module in modules("tools"):
        for tool in module.TOOLS:
            if tool.name in found:
                raise ValueError(f"two tools are called {tool.name}")
            found[tool.name] = tool
    return found


def page_of(rows: Sequence[Any], start: int, limit: int) -> dict[str, Any]:
    """The part of a list that an answer has, and where the next call goes on. InputError for what is no part."""
    if start < 0:
        raise InputError(f"start is {start}: give 0 or more")
    if not 1 <= limit <= MOST_ROWS:
        raise InputError(f"limit is {limit}: give 1 to {MOST_ROWS}")
    stop = min(start + limit, len(rows))
    return {"total": len(rows), "next_start": stop if stop < len(rows) else None, "rows": list(rows[start:stop])}


def brief(value: Any) -> Any:
    """The value with `DIGITS` significant digits; None in place of a number that is not finite."""
    if isinstance(value, bool) or not isinstance(value, float):
        return value
    return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None


def answer_of(value: msgspec.Struct) -> dict[str, Any]:
    """What a command writes as JSON, as an answer: each number is `brief`."""
    return _briefly(json.loads(json_of(value)))


def _briefly(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _briefly(each) for key, each in value.items()}
    return [_briefly(each) for each in value] if isinstance(value, list) else brief(value)
