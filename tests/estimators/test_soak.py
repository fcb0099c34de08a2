"""A long run holds no more than a short one: what States hold is counted. The study `soak` measures the time."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from functools import partial
from itertools import islice
from typing import Any

import numpy as np
import pytest

from ispom.ensemble import build
from ispom.methods import method as registered
from ispom.persistent_list import PersistentList
from tests.accuracy.soak import small_images
from tests.alone import ALL, METHODS, SURVEY
from tests.rounds import SCENARIOS, Scenario, rig

MEASURED = 120
"""Times that a State is measured."""
MEASURED_EVERY = 10
"""Frames: to walk a State takes about as long as a step."""
GROWN = 1.1
STANDING = ("still", "stops", "pairs end", "goes blank", "video goes blank")
"""Of the scenarios those in which most could pile up."""
RUNS = [
    pytest.param(name, s, marks=pytest.mark.slow if name not in METHODS or s.name not in STANDING[:2] else ())
    for name in ALL
    for s in SCENARIOS
    if s.name in (STANDING[:1] if name in SURVEY else STANDING) and s.kinds == registered(name).sensors
]


@pytest.mark.parametrize(
    ("method", "scenario"), RUNS, ids=lambda v: v if isinstance(v, str) else v.name.replace(" ", "-")
)
def test_a_state_does_not_grow(method: str, scenario: Scenario) -> None:
    config = small_images(method)
    if method == "integrated":
        config = config.with_settings(method, replace(config.of(method), max_views=120))
    ensemble = build(config, (method,), rig())
    state, sizes = ensemble.start(), []
    every = 2 if method in SURVEY else MEASURED_EVERY
    for i, exposure in enumerate(islice(scenario.exposures(), every * MEASURED)):
        state, _ = ensemble.step(state, exposure)
        if i % every == 0:
            sizes.append(size(state))
    early, late = (np.array(sizes[a:b]).max(axis=0) for a, b in ((60, 90), (90, 120)))
    assert (late <= GROWN * early).all(), f"values and bytes of arrays: {early} at first, {late} in the end"


def size(state: Any) -> tuple[int, int]:
    """Values that a State holds, without those that are the trajectory itself, and bytes of its arrays."""
    values, arrays, seen = 0, 0, set[int]()
    waiting = [state]
    while waiting:
        value = waiting.pop()
        if id(value) in seen or isinstance(value, PersistentList):
            continue
        seen.add(id(value))
        values += 1
        if isinstance(value, np.ndarray):
            base = value if value.base is None or not isinstance(value.base, np.ndarray) else value.base
            if base is value or id(base) not in seen:
                seen.add(id(base))
                arrays += base.nbytes
        elif is_dataclass(value) and not isinstance(value, type):
            waiting += [getattr(value, f.name) for f in fields(value)]
        elif isinstance(value, tuple | list | set | frozenset):
            waiting += value
        elif isinstance(value, dict):
            waiting += value.values()
        elif isinstance(value, partial):
            waiting += value.args
    return values, arrays
