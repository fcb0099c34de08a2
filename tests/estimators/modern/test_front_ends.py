"""Every front end finds and tracks for `stereo` as it does for `monocular`, and that of `klt` is as it was."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import ispom
from ispom.estimators.modern.monocular.estimator import ModernMonocularConfig
from ispom.estimators.modern.stereo.estimator import ModernStereo, ModernStereoConfig
from ispom.estimators.modern.stereo.pair import PAIR_KLT, pair_front_end
from ispom.features.front_ends import KLT, REGISTRY, front_end, front_ends
from ispom.features.interfaces import Detector, Tracker
from ispom.settings import settings
from ispom.testing import check_estimator
from ispom.types import Frame, Image, Measurement, Sequence, Status, Step, Trajectory, is_stereo
from tests.alone import stepped_through
from tests.same import assert_same

PAIRS = 6
CONFIGS = {"monocular": ModernMonocularConfig, "stereo": ModernStereoConfig}


def followed(estimator: ModernStereo, pairs: list[Frame]) -> tuple[Trajectory, list[Step]]:
    state, steps = stepped_through(estimator, pairs)
    return estimator.finish(state), steps


@pytest.fixture(scope="module")
def pairs(exposures: list[Measurement]) -> list[Frame]:
    return [e for e in exposures if is_stereo(e)][:PAIRS]


@pytest.mark.parametrize("name", front_ends())
def test_every_front_end_localises_pairs(name: str, flight: Sequence, pairs: list[Frame]) -> None:
    before = [image.copy() for pair in pairs for image in (pair.left, pair.right)]
    found, steps = followed(ModernStereoConfig(features=name).build(flight.rig), pairs)
    assert [s.status for s in steps] == [Status.INITIALISING] + [Status.TRACKING] * (len(pairs) - 1)
    truth = flight.truth
    assert truth is not None and len(found) == len(pairs)
    true = [truth.at(pair.time_ns) for pair in pairs]
    placed = true[0] @ found.at(pairs[0].time_ns).inverse()  # type: ignore[union-attr, operator]
    way = sum(np.linalg.norm(b.translation - a.translation) for a, b in pairwise(true))  # type: ignore[union-attr]
    for pair, pose in zip(pairs, true, strict=True):
        off = (placed @ found.at(pair.time_ns)).inverse() @ pose  # type: ignore[operator]
        assert np.linalg.norm(off.translation) < 0.005 * way and np.linalg.norm(off.rotvec) < np.radians(0.2)
    for image, copy in zip((image for pair in pairs for image in (pair.left, pair.right)), before, strict=True):
        np.testing.assert_array_equal(image, copy)


@pytest.mark.parametrize("name", front_ends())
def test_the_same_pairs_give_the_same_bits(name: str, flight: Sequence, pairs: list[Frame]) -> None:
    estimator = ModernStereoConfig(features=name).build(flight.rig)
    one, other = ([replace(s, seconds={}) for s in followed(estimator, pairs[:3])[1]] for _ in range(2))
    assert_same(one, other)


@pytest.mark.slow
@pytest.mark.parametrize("method", CONFIGS)
@pytest.mark.parametrize("name", [name for name in front_ends() if name != KLT.name])
def test_every_front_end_keeps_the_contract_of_methods(method: str, name: str) -> None:
    check_estimator(method, settings=CONFIGS[method](features=name))


def test_both_methods_have_the_same_choices() -> None:
    listed = [next(s for s in settings(config) if s.name == "features") for config in CONFIGS.values()]
    assert listed[0].type == listed[1].type and set(listed[1].type.__args__) == set(front_ends())
    assert all(config().features == KLT.name for config in CONFIGS.values())


def test_klt_is_as_it_suits_pairs_and_others_are_as_they_are() -> None:
    assert pair_front_end("klt") is PAIR_KLT and ModernStereoConfig().features == PAIR_KLT.name
    assert all(pair_front_end(name) is front_end(name) for name in front_ends() if name != "klt")
    with pytest.raises(ispom.InputError, match="freak"):
        pair_front_end("freak")


@dataclass(frozen=True)
class Noted:
    """A detector or tracker that notes for what it was called."""

    part: Any
    name: str
    calls: list[str]

    def detect(self, grey: Image, count: int, occupied: NDArray[np.float32], distance_px: float) -> NDArray[np.float32]:
        self.calls.append(self.name)
        detector: Detector = self.part
        return detector.detect(grey, count, occupied, distance_px)

    def track(
        self, start: Image, end: Image, uv: NDArray[np.float32], predicted: NDArray[np.float32] | None = None
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        self.calls.append(self.name + (" from predictions" if predicted is not None else ""))
        tracker: Tracker = self.part
        return tracker.track(start, end, uv, predicted)


@pytest.fixture
def noted() -> Iterator[list[str]]:
    """A front end named "noted", as a notebook registers it after settings were listed; gives its calls."""
    calls, plain = list[str](), front_end("shi_tomasi")
    assert all(settings(config) for config in CONFIGS.values())
    parts = {part: Noted(getattr(plain, part), part, calls) for part in ("detector", "tracker", "guided")}
    own = replace(plain, name="noted", **parts)
    ispom.register(own)
    yield calls
    REGISTRY.remove(own)


def test_that_of_a_notebook_detects_and_tracks(noted: list[str], flight: Sequence, pairs: list[Frame]) -> None:
    estimator = ModernStereoConfig(features="noted").build(flight.rig)
    _, steps = followed(estimator, pairs[:2])
    assert set(noted) == {"detector", "tracker"}, "no motion is known yet"
    _, steps = followed(estimator, pairs)
    assert "guided from predictions" in noted and {s.status for s in steps[1:]} == {Status.TRACKING}
    for method in CONFIGS:
        noted.clear()
        found = ispom.run(flight, method, frames=30, features="noted")
        assert found.located.any() and {"detector", "guided from predictions"} <= set(noted)
