"""Motion of one camera from lines: the start from three views, tracking in a small rendered room, and losses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ispom.estimators.survey.lines_monocular import LinesMonocular, LinesMonocularConfig
from ispom.evaluation.metrics import path_errors
from ispom.features.segments import Detector
from ispom.types import Frame, Sequence, Status, Step
from tests.alone import stepped_through
from tests.line_scene import line_sequence

Run = tuple[LinesMonocular, list[Step], Any]


@pytest.fixture(scope="module")
def room() -> Sequence:
    return line_sequence(18)


@pytest.fixture(scope="module")
def run(room: Sequence) -> Run:
    return ran(room, LinesMonocularConfig())


def ran(room: Sequence, config: LinesMonocularConfig) -> Run:
    estimator = config.build(room.rig)
    state, steps = stepped_through(estimator, (room[i] for i in range(len(room))))
    return estimator, steps, state


def test_it_starts_from_three_views_and_tracks_from_then_on(run: Run) -> None:
    _, steps, state = run
    status = [step.status for step in steps]
    start = status.index(Status.TRACKING)
    assert 2 <= start < 12
    assert set(status[:start]) == {Status.INITIALISING} and set(status[start:]) == {Status.TRACKING}
    assert any(d.key == "start_lines" and d.passed for d in steps[start].decisions)
    assert np.median(np.concatenate([step.residuals_px for step in steps[start + 1 :]])) < 1.0
    assert len(steps[-1].world_lines) == len(state.memory.map.ids) > 20


def test_the_path_has_the_shape_of_the_true_one(run: Run, room: Sequence) -> None:
    """Its lines are nearly all on one far wall, so that rotation and displacement are hard to tell apart."""
    estimator, _, state = run
    assert room.truth is not None
    length = np.linalg.norm(np.diff(room.truth.translations, axis=0), axis=1).sum()
    assert path_errors(estimator.finish(state), room.truth, room.rig, False)["ate_m"] < 0.06 * length


@pytest.mark.slow
@pytest.mark.parametrize("detector", ["hough", "canny"])
def test_the_other_detectors_give_it_too(room: Sequence, detector: Detector) -> None:
    found = ran(room, LinesMonocularConfig(detector=detector))
    test_it_starts_from_three_views_and_tracks_from_then_on(found)
    test_the_path_has_the_shape_of_the_true_one(found, room)


def test_lines_that_are_not_used_are_drawn_as_such(run: Run) -> None:
    _, steps, state = run
    lines = steps[-1].lines["video"]
    assert (lines.group >= 0).sum() == len(state.memory.lines) and (lines.group < 0).any()


def test_in_dark_frames_it_is_lost_and_goes_on_after_them(run: Run, room: Sequence) -> None:
    estimator, steps, state = run
    dark, time_ns, seen = np.full((240, 320), 9, np.uint8), steps[-1].time_ns, list[Step]()
    for k in range(1, 9):
        state, step = estimator.step(state, Frame.video(time_ns + k * 10**7, dark))
        seen.append(step)
    assert {step.status for step in seen} == {Status.LOST}
    assert len(seen[-1].world_lines) == len(steps[-1].world_lines)
    for i in range(10):
        frame = room[i]
        assert isinstance(frame, Frame)
        state, step = estimator.step(state, Frame.video(time_ns + 10**9 + i * 33_000_000, frame.image))
        seen.append(step)
    assert seen[-1].status is Status.TRACKING
