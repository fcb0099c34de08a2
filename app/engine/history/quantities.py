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
from .step_quantities import change_quantities, step_quantities

Row = Mapping[str, Mapping[str, Value]]
"""By method: the values by key at its latest step. The key "" has the values of the frame itself."""
NO_ROW: Row = MappingProxyType({})
"""Before the first frame."""

STEP_QUANTITIES = step_quantities()
"""In the order of the columns of steps.csv."""
POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
"""Keys of world_from_frame: the position in the method's own world and unit, and the orientation as a quaternion."""
MOMENTARY: Mapping[str, Value] = {"key_frame": False, "restarted": False, "segment_age_ns": None, "joins": None}
"""Values that hold at one frame only: at later frames without a step they have these defaults."""
CHANGES = change_quantities()
EXPOSURE_QUANTITIES = (
    Quantity("", "exposure", "number", "counted from 0"),
    Quantity("", "time_s", "number", "in the clock of the source", "s"),
)


def quantities(methods: Iterable[str]) -> Mapping[str, Quantity]:
    """Returns all quantities of a frame in a run of these methods, by name."""
    found = list(EXPOSURE_QUANTITIES)
    for method in sorted(methods, key=len):  # of `a.b.c`, method `a.b` wins over `a`
        found += [Quantity(method, q.key, q.kind, q.help, q.unit, q.choices) for q in STEP_QUANTITIES]
        found += [Quantity(method, key, "number", f"{key} of the pose as it was given then") for key in POSE]
        found.append(Quantity(method, "time_s", "number", "of its latest step, in the clock of the source", "s"))
        found += [Quantity(method, q.key, q.kind, q.help, q.unit) for q in CHANGES]
        for check in registered(method).checks.values():
            found += _of_check(method, check)
    return {quantity.name: quantity for quantity in found}


def step_values(step: Step, error_m: float | None) -> dict[str, Value]:
    """Returns the values of a step by key. Where a step has the same check several times, the one with the least margin
    counts."""
    found = {quantity.key: known(quantity.of(step, error_m)) for quantity in STEP_QUANTITIES}
    return found | pose_values(step) | check_values(step.decisions)


def step_number(step: Step, key: str) -> float | None:
    """Returns one of STEP_QUANTITIES of a step, if it is a known number."""
    value = known(next(quantity for quantity in STEP_QUANTITIES if quantity.key == key).of(step, None))
    return None if value is None or isinstance(value, str) else float(value)


def pose_values(step: Step) -> dict[str, Value]:
    """POSE of a step; nothing without one."""
    pose = step.world_from_frame
    return {} if pose is None else dict(zip(POSE, (*pose.translation.tolist(), *pose.xyzw.tolist()), strict=True))


def check_values(decisions: Iterable[Decision]) -> dict[str, Value]:
    """Returns the values of the checks of a step, by key."""
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
    """Returns the row at a frame with these steps, as `row_with` does."""
    values_by_method = {method: step_values(step, errors_m.get(method)) for method, step in by_method(steps).items()}
    return row_with(before, index, time_ns, values_by_method)


def row_with(before: Row, index: int, time_ns: int, values_by_method: Row) -> Row:
    """The row at a frame. Methods without a step there keep their latest values, except MOMENTARY ones."""
    return {
        **{method: _over(values) for method, values in before.items()},
        "": {"exposure": index, "time_s": time_ns / 1e9},
        **{
            method: _with_changes(before.get(method, {}), {**values, "time_s": time_ns / 1e9})
            for method, values in values_by_method.items()
        },
    }


def _with_changes(before: Mapping[str, Value], now: dict[str, Value]) -> Mapping[str, Value]:
    """Returns the values of a step with its CHANGES since the step before; after a restart these are unknown."""
    for quantity in CHANGES:
        now[quantity.key] = known(quantity.of({} if now.get("restarted") else before, now))
    return now


def _over(values: Mapping[str, Value]) -> Mapping[str, Value]:
    """Returns the row at a later frame without a step: MOMENTARY values get their defaults."""
    return {**values, **MOMENTARY} if any(values.get(key) for key in MOMENTARY) else values


def by_method(steps: Iterable[Step]) -> dict[str, Step]:
    """The steps of the run's methods, and of the estimators inside them that do not run by themselves."""
    found = {step.method: step for step in steps}
    for step in tuple(found.values()):
        for method, part in by_method(step.parts).items():
            found.setdefault(method, part)
    return found


def finite(value: float) -> float | None:
    """Returns the value as a Python float; None if it is not finite."""
    return float(value) if math.isfinite(value) else None


def known(value: Value) -> Value:
    """Returns None in place of a number that is not finite, and numpy's numbers as Python's."""
    return finite(value) if isinstance(value, float | np.floating) else value


def _of_check(method: str, check: Check) -> list[Quantity]:
    of = f"{check.question} {check.name}".strip()
    return [
        Quantity(method, check.key, "number", of, check.unit),
        Quantity(method, f"{check.key}.passed", "flag", f"{of}: whether it passed"),
        Quantity(method, f"{check.key}.margin", "number", f"{of}: how far on the passing side", check.unit),
        Quantity(method, f"{check.key}.threshold", "number", f"{of}: its threshold", check.unit),
    ]
