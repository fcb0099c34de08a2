"""Frames that were lost when they came are localised by keyframes that came later, and are revised poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.estimators.modern.monocular import lost_frames
from ispom.estimators.modern.monocular.estimator import ModernMonocularConfig
from ispom.estimators.modern.monocular.lost_frames import (
    MAX_LOST,
    TRIES,
    found_at_the_end,
    next_lost_frames,
    try_lost_frames,
)
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.setup import Setup
from ispom.estimators.modern.monocular.state import LostFrame, ModernMonocularState, Outcome
from ispom.estimators.modern.monocular.tracks import NewImage
from ispom.estimators.tracked_frame import ScenePoints
from ispom.geometry import Pose
from ispom.solvers.trajectory.alignment import umeyama
from ispom.types import Measurement, Sequence, Status, Step, as_grey, is_video
from tests.estimators.modern.setups import monocular_setup

GREY = np.zeros((4, 4), np.uint8)
MAP = Map((), ScenePoints(), None, 1.0)
LOST = slice(40, 43)
"""Frames of a flight that are lost."""


@pytest.fixture
def setup(flight: Sequence) -> Setup:
    return monocular_setup(flight.rig.camera("video"))


@pytest.fixture(scope="module")
def flown(flight: Sequence, exposures: list[Measurement]) -> tuple[dict[int, Step], list[int], np.ndarray]:
    """The steps of a flight by frame, without the lost ones; the times of these, and the errors of their final poses
    [m]."""
    estimator = ModernMonocularConfig(min_parallax_deg=1.0).build(flight.rig)
    frames = [e for e in exposures if is_video(e)][:60]
    state, steps = estimator.start(), dict[int, Step]()
    for i, frame in enumerate(frames):
        if i == LOST.stop:
            state = replace(state, lost_frames=tuple(LostFrame(f.time_ns, as_grey(f.image), 0) for f in frames[LOST]))
        if i not in range(60)[LOST]:
            state, steps[i] = estimator.step(state, frame)
    found, truth = estimator.finish(state), flight.truth
    assert truth is not None and len(found) == 60
    own, true = found.translations, truth.moved(right=flight.rig.rig_from("video"))
    at = np.array([true.at(f.time_ns).translation for f in frames])  # type: ignore[union-attr]
    error_m = np.linalg.norm(umeyama(own, at, with_scale=True).apply(own) - at, axis=1)
    return steps, [f.time_ns for f in frames[LOST]], error_m[LOST]


def test_lost_frames_have_poses_in_the_end(flown: tuple[dict[int, Step], list[int], np.ndarray]) -> None:
    steps, _, error_m = flown
    assert not any(s.restarted for s in steps.values())
    assert error_m.max() < 0.02, "of 1.2 m"


def test_their_poses_are_revisions_of_a_later_step(flown: tuple[dict[int, Step], list[int], np.ndarray]) -> None:
    steps, lost_ns, _ = flown
    for time_ns in lost_ns:
        (revising,) = [i for i, s in steps.items() if s.revised.at(time_ns) is not None]
        assert revising >= LOST.stop and steps[revising].key_frame


@pytest.fixture
def tried(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Times of the frames that are tried; those after 99 are found at their time."""
    times = list[int]()

    def found(_: object, state: ModernMonocularState, __: Map, frame: LostFrame) -> tuple[object, Pose | None]:
        times.append(frame.time_ns)
        return state, Pose(translation=np.full(3, float(frame.time_ns))) if frame.time_ns > 99 else None

    monkeypatch.setattr(lost_frames, "localise_lost_frame", found)
    return times


def waiting(*times_ns: int) -> ModernMonocularState:
    return ModernMonocularState(lost_frames=tuple(LostFrame(t, GREY, 0) for t in times_ns))


def outcome(status: Status = Status.TRACKING, *, key_frame: bool = True, since_ns: int | None = None) -> Outcome:
    return Outcome(lost_frames.NO_TRACKS, status, map=MAP, key_frame=key_frame, segment_from_ns=since_ns)


def test_the_newest_are_tried_first_and_each_only_so_often(setup: Setup, tried: list[int]) -> None:
    state = waiting(1, 2, 3)
    for _ in range(2 * TRIES):
        state, after = try_lost_frames(setup, state, outcome())
        assert after.settled == ()
    assert tried[:4] == [3, 2, 1, 3] and state.lost_frames == ()
    assert {t: tried.count(t) for t in (1, 2, 3)} == dict.fromkeys((1, 2, 3), TRIES)


def test_one_that_is_found_is_settled_and_tried_no_more(setup: Setup, tried: list[int]) -> None:
    state, after = try_lost_frames(setup, waiting(1, 100), outcome())
    assert [t for t, _ in after.settled] == [100] and [f.time_ns for f in state.lost_frames] == [1]
    assert tried == [100, 1]


def test_at_the_end_each_is_tried_as_often_as_is_left(setup: Setup, tried: list[int]) -> None:
    state = replace(waiting(1, 100), map=MAP)
    assert [t for t, _ in found_at_the_end(setup, state)] == [100]
    assert tried == [1] * TRIES + [100]
    assert found_at_the_end(setup, waiting(100)) == (), "without a map"


def test_frames_between_keyframes_try_none(setup: Setup, tried: list[int]) -> None:
    state = waiting(1)
    assert try_lost_frames(setup, state, outcome(key_frame=False))[0] is state and tried == []


def test_only_frames_without_a_pose_wait_and_none_of_a_segment_that_begins(setup: Setup) -> None:
    image = NewImage(7, GREY, None, lost_frames.NO_TRACKS, np.zeros((0, 3)))

    def times(found: Outcome, state: ModernMonocularState, using: Setup = setup) -> list[int]:
        return [f.time_ns for f in next_lost_frames(using, state, found, image)]

    assert times(outcome(Status.LOST), waiting(1)) == [1, 7]
    assert times(outcome(since_ns=2), waiting(1, 2, 3)) == [1]
    assert times(outcome(), waiting(1)) == [1]
    assert times(outcome(Status.LOST), waiting(1), replace(setup, relocalise=False)) == [1]
    assert times(outcome(Status.LOST), waiting(*range(MAX_LOST))) == [*range(1, MAX_LOST), 7]
