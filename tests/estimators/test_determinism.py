"""The same input gives the same bytes: twice, and with one and two threads of OpenCV and BLAS, for every method."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import pytest
from threadpoolctl import threadpool_limits

from ispom.ensemble import build
from ispom.methods import Config, possible_methods
from ispom.methods import method as registered
from ispom.sequences.formats.simulated import open_simulated
from ispom.types import Measurement, Rig, Sequence, Step, Trajectory
from tests.alone import OF_CAMERAS, OWN_SEQUENCES
from tests.doubles import rig

SECONDS = 1.2
"""Of the flight: key frames in both cameras, and a segment between stereo exposures."""
METHODS = [
    pytest.param(name, marks=pytest.mark.slow if registered(name).survey else ())
    for name in dict.fromkeys([*possible_methods(rig()), *OF_CAMERAS])
]
"""The contract test tries the others with several threads, too."""


@pytest.fixture
def threads() -> Iterator[None]:
    before = cv2.getNumThreads()
    yield
    cv2.setNumThreads(before)


def outcome(method: str, rig: Rig, exposures: list[Measurement]) -> tuple[dict[str, Trajectory], list[Step]]:
    ensemble = build(Config(), (method,), rig)
    state, steps = ensemble.start(), list[Step]()
    for exposure in exposures:
        state, found = ensemble.step(state, exposure)
        steps += found
    return ensemble.finish(state), steps


def as_bytes(found: dict[str, Trajectory], steps: list[Step]) -> dict[str, bytes]:
    poses = {n: t.times_ns.tobytes() + t.rotations.tobytes() + t.translations.tobytes() for n, t in found.items()}
    return poses | {"covariances": b"".join(s.covariance.tobytes() for s in steps if s.covariance is not None)}


@pytest.mark.usefixtures("threads")
@pytest.mark.parametrize("method", METHODS)
def test_same_bytes(method: str, flight: Sequence, exposures: list[Measurement], rendered: Path) -> None:
    if method in OF_CAMERAS:
        flight = open_simulated("ring5", cache_dir=rendered, duration_s=SECONDS)
        exposures = [flight[i] for i in range(len(flight))]
    if method in OWN_SEQUENCES:
        flight = OWN_SEQUENCES[method]()
        exposures = [flight[i] for i in range(len(flight))]
    short = [e for e in exposures if e.time_ns < SECONDS * 1e9]
    runs = []
    for count in (1, 2):
        cv2.setNumThreads(count)
        with threadpool_limits(count, "blas"):
            runs.append(outcome(method, flight.rig, short))
    assert all(len(t) > (-1 if registered(method).survey else 2) for t in runs[0][0].values())
    assert as_bytes(*runs[0]) == as_bytes(*runs[1])
