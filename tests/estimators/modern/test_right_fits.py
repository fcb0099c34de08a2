"""The integration where pairs measure nothing: a right camera that is covered, frozen, or exchanged with the left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.estimators.modern.integrated.estimator import ModernIntegratedConfig
from ispom.estimators.modern.integrated.localise import LATE_PAIRS, localise
from ispom.estimators.modern.integrated.observe import check_right_matches
from ispom.estimators.modern.integrated.state import ModernIntegratedState
from ispom.types import Frame, Measurement, Sequence, Status, Step, Tracks, TrackStatus, is_stereo
from tests.alone import alone, run
from tests.estimators.modern.setups import setup_of

FROM_S = 1.3
"""By then four pairs were taken."""


def broken(exposures: list[Measurement], how: str) -> list[Measurement]:
    """From FROM_S on."""
    since = exposures[0].time_ns + int(FROM_S * 1e9)
    frozen = next(e.right for e in reversed(exposures) if is_stereo(e) and e.time_ns < since)

    def changed(pair: Frame) -> Frame:
        if how == "exchanged":
            return pair.with_images(left=pair.right, right=pair.left)
        return pair.with_images(right=frozen if how == "frozen" else np.full_like(frozen, 12))

    return [changed(e) if is_stereo(e) and e.time_ns >= since else e for e in exposures]


@pytest.mark.parametrize("how", ["covered", "frozen", "exchanged"])
def test_pairs_whose_right_image_does_not_fit_are_passed_over_and_the_video_goes_on(
    flight: Sequence, exposures: list[Measurement], how: str
) -> None:
    assert flight.truth is not None
    seen = broken(exposures, how)
    steps = list(run(alone("integrated", flight.rig), seen))
    since = exposures[0].time_ns + int(FROM_S * 1e9)
    pairs = [s for s, e in zip(steps, seen, strict=True) if is_stereo(e)]
    assert all(s.status is Status.TRACKING for s in pairs if s.time_ns < since)
    after = [s for s in pairs if s.time_ns >= since]
    assert all(s.status is Status.LOST and s.world_from_frame is None for s in after[:3])
    assert {d.key for d in after[0].decisions if d.failed} == {"right_fits"}
    first = next(s for s in steps if s.world_from_frame is not None)
    origin = flight.truth.at(first.time_ns)
    assert origin is not None and first.world_from_frame is not None
    onto = origin @ first.world_from_frame.inverse()
    for step in steps:
        if step.time_ns < since or step.world_from_frame is None or step.time_ns >= after[3].time_ns:
            continue
        true = flight.truth.at(step.time_ns)
        assert true is not None and step.covariance is not None
        error = np.linalg.norm((onto @ step.world_from_frame).translation - true.translation)
        assert error < 0.01 + 4 * np.sqrt(np.trace(step.covariance[:3, :3]))


def test_a_gap_in_pairs_is_bridged_by_points_that_were_adjusted_and_by_no_others(
    flight: Sequence, exposures: list[Measurement]
) -> None:
    """A view at the window's end, seen again later."""
    estimator = alone("integrated", flight.rig)
    state = estimator.start()
    for exposure in exposures[:60]:
        state, _ = estimator.step(state, exposure)
    mine: ModernIntegratedState = state["integrated"]
    setup, reference = setup_of(ModernIntegratedConfig().build(flight.rig)), mine.window.reference
    assert reference is not None
    times = [mine.window.views[i].time_ns for i in mine.window.pairs]
    view = next(v for v in reversed(mine.window.views) if v.video)
    guessed = replace(mine, window=replace(mine.window, reference=replace(reference, ids=reference.ids[:0])))
    soon, late = times[-1] + max(np.diff(times)), times[-1] + (LATE_PAIRS + 1) * max(np.diff(times))
    for known, time_ns, passed, status in (
        (mine, late, 0, Status.TRACKING),
        (guessed, soon, 0, Status.TRACKING),
        (guessed, late, 0, Status.LOST),
        (guessed, soon, LATE_PAIRS, Status.LOST),
    ):
        _, found, said = localise(setup, replace(known, skipped=passed), replace(view, time_ns=int(time_ns)))
        assert found is not None and said is status


def test_the_right_image_fits_where_most_points_of_the_left_one_have_a_match_in_it() -> None:
    def share(alive: int, matched: int, wrong: int, new: int = 0) -> float:
        count = alive + wrong + new
        status = np.repeat([TrackStatus.ALIVE, TrackStatus.REPROJECTION, TrackStatus.NEW], [alive, wrong, new])
        disparity = np.full(count, np.nan, np.float32)
        disparity[:matched], disparity[alive + wrong :] = 5.0, 5.0
        tracks = Tracks.of(np.arange(count), np.zeros((count, 2)), status=status, disparity_px=disparity)
        return check_right_matches(Step(0, Status.TRACKING, tracks={"left": tracks})).value

    assert share(100, 95, 10) == pytest.approx(95 / 110)
    assert share(100, 20, 80, new=300) == pytest.approx(20 / 180)
    assert share(12, 9, 0) == pytest.approx(9 / 30)
    assert share(0, 0, 0, new=40) == 1.0
    assert check_right_matches(Step(0, Status.LOST)).failed
