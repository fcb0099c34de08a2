"""What `ispom bench` measured of one method on one source."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Row:
    """See measure.py for what was found; {"error": ...} where nothing was."""

    case: str
    method: str
    found: dict[str, Any]
