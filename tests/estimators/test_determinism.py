"""The same input gives the same bytes: twice, and with one and two OpenCV threads, for every method."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import pytest

from ispom.ensemble import build
from ispom.methods import Config, possible_methods
from ispom.types import Exposure, Rig, Sequence, Trajectory
from tests.doubles import rig

SECONDS = 1.2
"""Of the flight: key frames in both cameras, and a segment between stereo exposures."""


@pytest.fixture
def threads() -> Iterator[None]:
    before = cv2.getNumThreads()
    yield
    cv2.setNumThreads(before)


def trajectories(method: str, rig: Rig, exposures: list[Exposure]) -> dict[str, Trajectory]:
    ensemble = build(Config(), (method,), rig)
    state = ensemble.start()
    for exposure in exposures:
        state, _ = ensemble.step(state, exposure)
    return ensemble.finish(state)


def as_bytes(found: dict[str, Trajectory]) -> dict[str, bytes]:
    return {n: t.times_ns.tobytes() + t.rotations.tobytes() + t.translations.tobytes() for n, t in found.items()}


@pytest.mark.usefixtures("threads")
@pytest.mark.parametrize("method", possible_methods(rig()))
def test_same_bytes(method: str, flight: Sequence, exposures: list[Exposure]) -> None:
    short = [e for e in exposures if e.time_ns < SECONDS * 1e9]
    runs = []
    for count in (1, 2):
        cv2.setNumThreads(count)
        runs.append(trajectories(method, flight.rig, short))
    assert all(len(t) > 2 for t in runs[0].values())
    assert as_bytes(runs[0]) == as_bytes(runs[1])
