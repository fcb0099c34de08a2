"""How the integration takes over what the monocular method finds out about the video's lens."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from ispom.estimators.modern.integrated.report import jacobian_by_lens
from ispom.estimators.modern.lens import corrected
from ispom.geometry import Array
from ispom.types import LensCorrection, Measurement, Sequence, Step, is_stereo
from tests.alone import alone

Asked = list[tuple[Measurement, dict[str, Step]]]
CHANGED = np.array([2e-3, -4e-3])
"""A focal length that is 0.2 % longer, as the first minutes find it."""


def test_places_change_with_the_lens_as_finite_differences_say() -> None:
    seen, eps = np.random.default_rng(1).uniform(-0.5, 0.5, (20, 2)), 1e-6
    for i, found in enumerate(np.moveaxis(jacobian_by_lens(seen), 2, 0)):
        difference = (corrected(seen, eps * np.eye(2)[i]) - seen) / eps
        np.testing.assert_allclose(found, difference, atol=1e-5)


@pytest.fixture(scope="module")
def asked(flight: Sequence, exposures: list[Measurement]) -> Asked:
    """What the methods that it asks say up to the fourth pair."""
    ensemble = alone("integrated", flight.rig).ensemble
    members = {name: member for name, member in ensemble.members.items() if name != "integrated"}
    state, found = {name: member.estimator.start() for name, member in members.items()}, Asked()
    for exposure in exposures[: places_of_pairs(exposures)[3] + 1]:
        steps = dict[str, Step]()
        for name, member in members.items():
            if member.method.uses(exposure):
                state[name], steps[name] = member.estimator.step(state[name], exposure)
        found.append((exposure, ensemble.members["integrated"].inputs(steps)[0]))
    return found


def places_of_pairs(exposures: list[Measurement]) -> list[int]:
    return [i for i, e in enumerate(exposures) if is_stereo(e)]


def walked(flight: Sequence, asked: Asked, lens: Mapping[int, Array]) -> tuple[list[Step], list[Array]]:
    """The Steps, and the correction in the window after each, with these corrections found at their exposures."""
    estimator = alone("integrated", flight.rig).ensemble.members["integrated"].estimator
    state, steps, used, now = estimator.start(), list[Step](), list[Array](), np.zeros(2)
    for i, (exposure, parts) in enumerate(asked):
        now = lens.get(i, now)
        told = {
            n: replace(p, calibration=replace(p.calibration, lens=LensCorrection.of(now))) for n, p in parts.items()
        }
        state, step = estimator.step(state, exposure, told)
        steps.append(step)
        used.append(state.window.lens_correction)
    return steps, used


def test_frames_are_placed_with_the_lens_by_which_their_points_were_adjusted(flight: Sequence, asked: Asked) -> None:
    pairs = places_of_pairs([exposure for exposure, _ in asked])
    change = pairs[2] + 4
    steps, used = walked(flight, asked, {change: CHANGED})
    plain, _ = walked(flight, asked, {})
    for i in range(pairs[3]):
        # Else all frames from the change on would jump along the view: points do not lie where they would be seen.
        np.testing.assert_array_equal(used[i], np.zeros(2))
        a, b = steps[i].world_from_frame, plain[i].world_from_frame
        assert (a is None) == (b is None)
        if a is not None and b is not None:
            np.testing.assert_array_equal(a.translation, b.translation)
    np.testing.assert_array_equal(used[pairs[3]], CHANGED)


def test_before_the_first_adjustment_a_lens_is_taken_over_at_once(flight: Sequence, asked: Asked) -> None:
    pairs = places_of_pairs([exposure for exposure, _ in asked])
    change = pairs[0] + 4
    assert change < pairs[1]
    _, used = walked(flight, asked[: pairs[1]], {change: CHANGED})
    np.testing.assert_array_equal(used[change - 1], np.zeros(2))
    np.testing.assert_array_equal(used[change], CHANGED)
