"""The quantities of a frame, by stable name: METHOD.KEY, the same in tables, break points, plots and comparisons.

`monocular.inliers`, `stereo.status`: what each Step says (STEP_QUANTITIES), in the columns of steps.csv.
`monocular.x`, `.moved`: its pose, in columns of steps.csv as well, and how far it is from the one before.
`monocular.parallax`, `.passed`, `.margin`, `.threshold`: what each check of the method says, in decisions.csv.
`exposure`, `time_s`: which frame it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from types import MappingProxyType

import numpy as np

from ispom.methods import method as registered
from ispom.types import Check, Decision, Step

from .quantity import Quantity, Value
from .step_quantities import step_quantities

Row = Mapping[str, Mapping[str, Value]]
"""By method: the values by key at its latest step; under "" those of the frame itself."""
NO_ROW: Row = MappingProxyType({})
"""Before the first frame."""

STEP_QUANTITIES = step_quantities()
"""In the order of the columns of steps.csv."""
POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
"""Keys of world_from_frame: the position in the method's own world and unit, and the orientation as a quaternion."""
MOMENTARY: Mapping[str, Value] = {"key_frame": False, "restarted": False, "joins": None}
"""Of one frame: another method's step does not report them again."""
WAY = ("way_x", "way_y", "way_z")
"""Keys of the mean step as a vector: far shorter than `moved_usual` where a pose only trembles about its place."""
USUAL_STEPS = 10.0
"""Over about so many steps the usual one is an exponential mean."""
MOTION: Mapping[str, tuple[str, str]] = {
    "moved": ("distance from its pose one step before, in its unit", ""),
    "turned_deg": ("angle to its pose one step before", "deg"),
    "moved_usual": (f"mean of `moved` over about the {USUAL_STEPS:.0f} steps before this one that moved", ""),
}
"""By key, help and unit: the change of a step since the one before it."""
EXPOSURE_QUANTITIES = (
    Quantity("", "exposure", "number", "counted from 0"),
    Quantity("", "time_s", "number", "in the clock of the source", "s"),
)


def quantities(methods: Iterable[str]) -> Mapping[str, Quantity]:
    """By name: all quantities of a frame in a run of these methods."""
    found = list(EXPOSURE_QUANTITIES)
    for method in sorted(methods, key=len):  # of `a.b.c`, method `a.b` wins over `a`
        found += [Quantity(method, q.key, q.kind, q.help, q.unit, q.choices) for q in STEP_QUANTITIES]
        found += [Quantity(method, key, "number", f"{key} of the pose as it was given then") for key in POSE]
        found += [Quantity(method, key, "number", text, unit) for key, (text, unit) in MOTION.items()]
        found += [Quantity(method, key, "number", f"mean step along {key[-1]}, this one included") for key in WAY]
        for check in registered(method).checks.values():
            found += _of_check(method, check)
    return {quantity.name: quantity for quantity in found}


def step_values(step: Step, error_m: float | None) -> dict[str, Value]:
    """By key. Where a step has the same check several times, that of the least margin counts."""
    found = {quantity.key: known(quantity.of(step, error_m)) for quantity in STEP_QUANTITIES}
    return found | pose_values(step) | check_values(step.decisions)


def step_number(step: Step, key: str) -> float | None:
    """One of STEP_QUANTITIES of a step, where it is a known number."""
    value = known(next(quantity for quantity in STEP_QUANTITIES if quantity.key == key).of(step, None))
    return None if value is None or isinstance(value, str) else float(value)


def pose_values(step: Step) -> dict[str, Value]:
    """POSE of a step; nothing without one."""
    pose = step.world_from_frame
    return {} if pose is None else dict(zip(POSE, (*pose.translation.tolist(), *pose.xyzw.tolist()), strict=True))


def check_values(decisions: Iterable[Decision]) -> dict[str, Value]:
    """What the checks of a step say, by key."""
    found: dict[str, Value] = {}
    worst: dict[str, Decision] = {}
    for decision in decisions:
        if decision.key not in worst or decision.margin < worst[decision.key].margin:
            worst[decision.key] = decision
    for key, d in worst.items():
        found |= {key: finite(d.value), f"{key}.passed": bool(d.passed)}
        found |= {f"{key}.margin": finite(d.margin), f"{key}.threshold": finite(d.threshold)}
    return found


def row_after(before: Row, index: int, time_ns: int, steps: Iterable[Step], errors_m: Mapping[str, float]) -> Row:
    """The row at a frame, of its steps: see `row_with`."""
    values_by_method = {method: step_values(step, errors_m.get(method)) for method, step in by_method(steps).items()}
    return row_with(before, index, time_ns, values_by_method)


def row_with(before: Row, index: int, time_ns: int, values_by_method: Row) -> Row:
    """The row at a frame. Methods without a step there keep their latest values, except MOMENTARY ones."""
    return {
        **{method: _over(values) for method, values in before.items()},
        "": {"exposure": index, "time_s": time_ns / 1e9},
        **{
            method: {**values, **_motion(before.get(method, {}), values)} for method, values in values_by_method.items()
        },
    }


def _motion(before: Mapping[str, Value], now: Mapping[str, Value]) -> dict[str, Value]:
    """MOTION and WAY of a step, from its values and those of the method's step before it; none over a restart."""
    if now.get("restarted"):
        return dict.fromkeys((*MOTION, *WAY))
    usual, moved = _number(before.get("moved_usual")), _number(before.get("moved"))
    way = {key: before.get(key) for key in WAY}
    if moved:  # a pose that is repeated, also for another camera's frame, has no motion
        usual = moved if usual is None else usual + (moved - usual) / USUAL_STEPS
    was, here = (_numbers(values) for values in (before, now))
    if was is None or here is None:
        return {"moved": None, "turned_deg": None, "moved_usual": usual, **way}
    away = min(math.dist(was[3:], here[3:]), math.dist(was[3:], [-q for q in here[3:]]))  # q and -q are one orientation
    turned = math.degrees(4 * math.asin(min(away / 2, 1.0)))
    moved = math.dist(was[:3], here[:3])
    for axis, key in enumerate(WAY if moved else ()):
        mean = _number(way[key]) or 0.0
        way[key] = mean + (here[axis] - was[axis] - mean) / USUAL_STEPS
    return {"moved": moved, "turned_deg": turned, "moved_usual": usual, **way}


def _numbers(values: Mapping[str, Value]) -> list[float] | None:
    """The pose among the values of a step."""
    found = [number for key in POSE if (number := _number(values.get(key))) is not None]
    return found if len(found) == len(POSE) else None


def _number(value: Value) -> float | None:
    return None if value is None or isinstance(value, str) else float(value)


def _over(values: Mapping[str, Value]) -> Mapping[str, Value]:
    """The row at a later frame: what happened at one frame is over."""
    return {**values, **MOMENTARY} if any(values.get(key) for key in MOMENTARY) else values


def by_method(steps: Iterable[Step]) -> dict[str, Step]:
    """The steps of the run's methods, and of the estimators inside them that do not run by themselves."""
    found = {step.method: step for step in steps}
    for step in tuple(found.values()):
        for method, part in by_method(step.parts).items():
            found.setdefault(method, part)
    return found


def finite(value: float) -> float | None:
    """As Python's; None in place of a number that is not finite."""
    return float(value) if math.isfinite(value) else None


def known(value: Value) -> Value:
    """None in place of a number that is not finite; numpy's numbers as Python's."""
    return finite(value) if isinstance(value, float | np.floating) else value


def _of_check(method: str, check: Check) -> list[Quantity]:
    of = f"{check.question} {check.name}".strip()
    return [
        Quantity(method, check.key, "number", of, check.unit),
        Quantity(method, f"{check.key}.passed", "flag", f"{of}: whether it passed"),
        Quantity(method, f"{check.key}.margin", "number", f"{of}: how far on the passing side", check.unit),
        Quantity(method, f"{check.key}.threshold", "number", f"{of}: its threshold", check.unit),
    ]
