"""How far each step is from the one before it, by the poses as they were given."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from ..quantity import ChangeQuantity, Value, number_of

Values = Mapping[str, Value]
POSITION, ORIENTATION = ("x", "y", "z"), ("qx", "qy", "qz", "qw")
WAY = ("way_x", "way_y", "way_z")
"""Keys of the mean step as a vector: far shorter than `moved_usual` where a pose only trembles about its place."""
USUAL_STEPS = 10.0
"""The usual step is an exponential mean over about this number of steps."""


def _same_moment(before: Values, now: Values) -> bool:
    """Returns whether the step has the time of the step before, as a pair after a video frame of the same time. The
    difference of their poses is no motion then."""
    return now.get("time_s") is not None and before.get("time_s") == now.get("time_s")


def _moved(before: Values, now: Values) -> float | None:
    if _same_moment(before, now):
        return number_of(before.get("moved"))
    was, here = _numbers(before, POSITION), _numbers(now, POSITION)
    return None if was is None or here is None else math.dist(was, here)


def _turned_deg(before: Values, now: Values) -> float | None:
    was, here = _numbers(before, ORIENTATION), _numbers(now, ORIENTATION)
    if was is None or here is None:
        return None
    away = min(math.dist(was, here), math.dist(was, [-q for q in here]))  # q and -q are one orientation
    return math.degrees(4 * math.asin(min(away / 2, 1.0)))


def _moved_usual(before: Values, now: Values) -> float | None:
    usual, moved = number_of(before.get("moved_usual")), number_of(before.get("moved"))
    if not moved:  # a pose that is repeated, also for another camera's frame, has no motion
        return usual
    return moved if usual is None else usual + (moved - usual) / USUAL_STEPS


def _mean_step(axis: str) -> Callable[[Values, Values], float | None]:
    def mean_step(before: Values, now: Values) -> float | None:
        known, was, here = (
            number_of(of.get(key)) for of, key in ((before, f"way_{axis}"), (before, axis), (now, axis))
        )
        if not now.get("moved") or was is None or here is None or _same_moment(before, now):
            return known
        return (known or 0.0) + (here - was - (known or 0.0)) / USUAL_STEPS

    return mean_step


def _numbers(values: Values, keys: tuple[str, ...]) -> list[float] | None:
    found = [number for key in keys if (number := number_of(values.get(key))) is not None]
    return found if len(found) == len(keys) else None


QUANTITIES = (
    ChangeQuantity("moved", _moved, "distance from its pose at the moment before, in its unit"),
    ChangeQuantity("turned_deg", _turned_deg, "angle to its pose one step before", unit="deg"),
    ChangeQuantity(
        "moved_usual",
        _moved_usual,
        f"mean of `moved` over about the {USUAL_STEPS:.0f} steps before this one that moved",
    ),
    *(ChangeQuantity(key, _mean_step(key[-1]), f"mean step along {key[-1]}, this one included") for key in WAY),
)
