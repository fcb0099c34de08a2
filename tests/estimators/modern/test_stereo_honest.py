"""Stereo where it cannot know: left and right exchanged, or a loss before any motion was measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.estimators.modern.stereo.estimator import ModernStereoConfig
from ispom.estimators.modern.stereo.predict import LastPair
from ispom.geometry import Pose
from ispom.types import Frame, Measurement, Sequence, Status, Step
from tests.alone import run
from tests.estimators.modern.test_stereo import pairs_of


def exchanged(pair: Frame) -> Frame:
    return pair.with_images(left=pair.right, right=pair.left)


def says(step: Step, key: str) -> bool:
    return any(d.key == key and d.failed for d in step.decisions)


def test_exchanged_images_are_no_start_and_told(flight: Sequence, exposures: list[Measurement]) -> None:
    """Its own wrong matches made a map of them now and then, and a start at rest in another place."""
    steps = list(run(ModernStereoConfig().build(flight.rig), [exchanged(p) for p in pairs_of(exposures)]))
    assert {s.status for s in steps} == {Status.INITIALISING}
    assert all(s.world_from_frame is None and says(s, "images_exchanged") for s in steps)


@pytest.mark.parametrize("count", [1, 5])
def test_images_exchanged_later_are_lost_and_told_until_they_are_put_right(
    count: int, flight: Sequence, exposures: list[Measurement]
) -> None:
    """Located by the left image alone, they would be at the right camera's place."""
    pairs = pairs_of(exposures)
    given = [exchanged(p) if 2 <= i < 2 + count else p for i, p in enumerate(pairs)]
    steps = list(run(ModernStereoConfig().build(flight.rig), given))
    wrong, after = steps[2 : 2 + count], steps[2 + count :]
    assert all(s.status is Status.LOST and s.world_from_frame is None for s in wrong)
    assert all(says(s, "images_exchanged") for s in wrong)
    assert after and all(s.status is Status.TRACKING and not s.restarted for s in after)
    assert not any(says(s, "images_exchanged") for s in (*steps[:2], *after))


def test_a_start_after_a_loss_before_any_motion_is_as_unsure_as_a_moving_rig(
    flight: Sequence, exposures: list[Measurement]
) -> None:
    """One pair, another place, and the first place again, farther on: the rig may have moved all the time."""
    assert flight.truth is not None
    pairs = pairs_of(exposures)
    other = pairs[1].with_images(left=pairs[1].left[::-1].copy(), right=pairs[1].right[::-1].copy())
    config = ModernStereoConfig(max_lost_pairs=0)
    steps = list(run(config.build(flight.rig), [pairs[0], other, *pairs[3:]]))
    assert [s.restarted for s in steps] == [False, True, True, *[False] * (len(pairs) - 4)]
    for step in steps[1:]:
        assert step.world_from_frame is not None and step.covariance is not None
        first, now = flight.truth.at(pairs[0].time_ns), flight.truth.at(step.time_ns)
        assert first is not None and now is not None
        gone = np.linalg.norm(now.translation - first.translation)
        assert np.sqrt(np.linalg.eigvalsh(step.covariance[:3, :3])[0]) > gone


def test_what_is_not_known_of_a_motion_grows_with_time_until_one_was_measured() -> None:
    none = LastPair(time_ns=0, left_from_world=Pose())
    one, ten = (none.predicted_covariance(int(s * 1e9), 0.1) for s in (1, 10))
    sigma = np.sqrt(np.diag(one)), np.sqrt(np.diag(ten))
    assert sigma[0][0] > 3 and sigma[1][0] > 9.9 * sigma[0][0] and sigma[1][5] > np.pi
    rest = replace(none, motion_s=0.5)
    assert np.sqrt(rest.predicted_covariance(int(1e10), 0.1).max()) < 0.1
