"""What `ispom bench` measured of one method on one source."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Row:
    """See measure.py for what was found; {"error": ...} where nothing was."""

    case: str
    method: str
    found: dict[str, Any]


def plain(value: Any) -> Any:
    """The value for JSON, which has no word for a number that is not finite: null instead."""
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
