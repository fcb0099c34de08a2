"""Motion from lines on short simulated flights, lost pairs, and real pairs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ispom.estimators.survey.lines import Lines, LinesConfig
from ispom.evaluation.metrics import path_errors
from ispom.features.segments import Detector
from ispom.sequences import open_sequence
from ispom.types import Frame, Sequence, Status, Step
from tests.alone import stepped_through

DATA = Path(__file__).parents[4] / "shared" / "data"


def steps_of(sequence: Sequence, config: LinesConfig, most: int = 1000) -> tuple[Lines, list[Step], Any]:
    estimator = config.build(sequence.rig)
    pairs = [i for i, kind in enumerate(sequence.kinds) if kind == "stereo"][:most]
    state, steps = stepped_through(estimator, (sequence[i] for i in pairs))
    return estimator, steps, state


@pytest.fixture(scope="module")
def flight() -> Sequence:
    return open_sequence("sim:tiny")


@pytest.fixture(scope="module")
def run(flight: Sequence) -> tuple[Lines, list[Step], Any]:
    return steps_of(flight, LinesConfig(), 6)


def test_the_path_is_metric(run: tuple, flight: Sequence) -> None:
    estimator, steps, state = run
    assert all(step.status is Status.TRACKING for step in steps)
    assert flight.truth is not None
    assert path_errors(estimator.finish(state), flight.truth, flight.rig, True)["ate_m"] < 0.01


@pytest.mark.parametrize("detector", ["hough", "canny"])
def test_the_other_detectors_give_it_too(flight: Sequence, detector: Detector) -> None:
    estimator, _, state = steps_of(flight, LinesConfig(detector=detector, manhattan=True), 4)
    assert flight.truth is not None
    assert path_errors(estimator.finish(state), flight.truth, flight.rig, True)["ate_m"] < 0.02


def test_lines_of_the_image_have_the_groups_of_their_directions(run: tuple) -> None:
    _, steps, state = run
    last = steps[-1]
    lines, known = last.lines["left"], state.memory.lines
    assert (lines.group >= 0).sum() == len(known) and (lines.group < 0).any()
    assert len(last.world_lines) == len(state.memory.map.ids) > 20
    along = known.xyz[:, 1] - known.xyz[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    pointing = known.group < len(state.memory.map.directions)
    assert pointing.any()
    cosine = np.abs(np.einsum("ni,ni->n", along[pointing], state.memory.map.directions[known.group[pointing]]))
    assert np.median(cosine) > np.cos(np.radians(8))


def test_lines_that_are_seen_again_get_more_exact(run: tuple) -> None:
    _, _, state = run
    known = state.memory.lines
    assert np.median(known.sigma_px[known.views >= 4]) < np.median(known.sigma_px[known.views == 1])


def test_after_dark_pairs_a_new_segment_begins_at_the_last_pose(run: tuple, flight: Sequence) -> None:
    estimator, steps, state = run
    dark = np.full((flight.rig.camera("left").height, flight.rig.camera("left").width), 9, np.uint8)
    pairs = [i for i in range(len(flight)) if flight.kinds[i] == "stereo"][6:8]
    time_ns, seen = steps[-1].time_ns, list[Step]()
    for _ in range(4):
        time_ns += 10**8
        state, step = estimator.step(state, Frame.stereo(time_ns, dark, dark))
        seen.append(step)
    assert {step.status for step in seen} == {Status.LOST}
    again = flight[pairs[0]]
    assert isinstance(again, Frame)
    state, step = estimator.step(state, Frame.stereo(time_ns + 1, again.left, again.right))
    assert step.world_from_frame is not None


@pytest.mark.slow
@pytest.mark.skipif(not (DATA / "kitti").is_dir(), reason="the KITTI recording is not in ../shared/data")
def test_drift_on_kitti() -> None:
    sequence = open_sequence(str(DATA / "kitti" / "sequences" / "06"))
    estimator, _, state = steps_of(sequence, LinesConfig())
    assert sequence.truth is not None
    assert path_errors(estimator.finish(state), sequence.truth, sequence.rig, True)["t_err_percent"] < 3.0
