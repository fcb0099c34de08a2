"""The same input gives the same bytes: twice, and with one and two OpenCV threads, for every method and variant."""

from __future__ import annotations

from collections.abc import Iterator
from typing import get_args

import cv2
import pytest

from ispom.estimators import Config, Method, Variant, build, possible_methods
from ispom.types import Exposure, Rig, Sequence, Trajectory
from tests.doubles import rig

REGISTERED = [(variant, method) for variant in get_args(Variant) for method in possible_methods(rig(), variant)]
SECONDS = 1.2
"""Of the flight: key frames in both cameras, and a segment between stereo exposures."""


@pytest.fixture
def threads() -> Iterator[None]:
    before = cv2.getNumThreads()
    yield
    cv2.setNumThreads(before)


def trajectories(variant: Variant, method: Method, rig: Rig, exposures: list[Exposure]) -> dict[str, Trajectory]:
    ensemble = build(Config(variant=variant), (method,), rig)
    state = ensemble.start()
    for exposure in exposures:
        state, _ = ensemble.step(state, exposure)
    return ensemble.finish(state)


def as_bytes(found: dict[str, Trajectory]) -> dict[str, bytes]:
    return {n: t.times_ns.tobytes() + t.rotations.tobytes() + t.translations.tobytes() for n, t in found.items()}


@pytest.mark.usefixtures("threads")
@pytest.mark.parametrize(("variant", "method"), REGISTERED)
def test_same_bytes(variant: Variant, method: Method, flight: Sequence, exposures: list[Exposure]) -> None:
    short = [e for e in exposures if e.time_ns < SECONDS * 1e9]
    runs = []
    for count in (1, 2):
        cv2.setNumThreads(count)
        runs.append(trajectories(variant, method, flight.rig, short))
    assert all(len(t) > 2 for t in runs[0].values())
    assert as_bytes(runs[0]) == as_bytes(runs[1])
