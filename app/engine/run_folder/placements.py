"""Where in the shared world each method's own world is, and since which frame, as run.yaml stores it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Pose, Similarity

from ..events import Stepped
from .run_folder import RUN

COUNTS = {"translation": 3, "quaternion_xyzw": 4}
Placed = tuple[int, str, Similarity]
"""The frame from which on it holds, the method, and the shared world from the method's own."""


class PlacementLog:
    """Notes each placement at the frame that gave it."""

    def __init__(self) -> None:
        self.entries: list[dict[str, Any]] = []
        """As run.yaml has them."""
        self._known: dict[str, Similarity] = {}

    def add(self, event: Stepped) -> None:
        for method, placement in event.placements.items():
            if self._known.get(method) is not placement:
                self._known[method] = placement
                self.entries.append(
                    {
                        "exposure": event.index,
                        "method": method,
                        "scale": float(placement.scale),
                        "translation": placement.pose.translation.tolist(),
                        "quaternion_xyzw": placement.pose.xyzw.tolist(),
                    }
                )


def placed(entries: Iterable[Mapping[str, Any]]) -> list[Placed]:
    """What `PlacementLog` noted; InputError where run.yaml has something else."""
    return [_placed(entry) for entry in entries]


def _placed(entry: Mapping[str, Any]) -> Placed:
    exposure, method, scale = (entry.get(name) for name in ("exposure", "method", "scale"))
    numbers = [entry.get(name) for name in COUNTS]
    good = isinstance(exposure, int) and isinstance(method, str) and isinstance(scale, float) and scale > 0
    good = good and all(
        isinstance(found, list) and len(found) == count and all(map(_is_number, found))
        for found, count in zip(numbers, COUNTS.values(), strict=True)
    )
    translation, xyzw = numbers
    if not good or not math.isclose(math.hypot(*xyzw), 1.0, abs_tol=0.01):  # type: ignore[misc]
        raise InputError(f"{RUN} says of a placement {str(entry)[:60]!r}: restore the file, or run again")
    return exposure, method, Similarity(scale, Pose.from_xyzw(np.array(xyzw), np.array(translation)))  # type: ignore[return-value]


def _is_number(value: Any) -> bool:
    return isinstance(value, float) and math.isfinite(value)
