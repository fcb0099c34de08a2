"""Methods whose world is not at the start (a tag, the origin of a GNSS): where they, others and the truth are drawn."""

from __future__ import annotations

import numpy as np
import pytest
from ispom_app.engine.model.true_path import TruePath
from ispom_app.engine.playback import Playback
from ispom_app.session.current_run import CurrentRun

from ispom.estimators.survey.tags import TagsConfig
from ispom.methods import Config
from ispom.sequences import open_sequence

SOURCE, FRAMES, SIDE_M = "sim:tiny?place=tags&motion=sideways", 70, 1.2


def ran(*methods: str) -> CurrentRun:
    sequence = open_sequence(SOURCE, max_exposures=FRAMES)
    run = CurrentRun(Playback(sequence, methods, Config({"tags": TagsConfig(side_m=SIDE_M)})), 10**8)
    for _ in range(FRAMES):
        run.step()
    return run


@pytest.fixture(scope="module")
def alone() -> CurrentRun:
    return ran("tags")


@pytest.fixture(scope="module")
def with_pairs() -> CurrentRun:
    return ran("tags", "stereo")


def positions(run: CurrentRun, method: str) -> dict[int, np.ndarray]:
    """Of the rig in the shared world, by frame, as placed in the end."""
    steps = [step for i in range(FRAMES) for step in run.history[i].steps if step.method == method]
    placed = [(step.time_ns, run.playback.placed(step)) for step in steps]
    return {time_ns: pose.translation for time_ns, pose in placed if pose is not None}


def test_the_truth_is_drawn_at_the_poses_and_no_error_is_stated_against_it_as_it_is(alone: CurrentRun) -> None:
    path, last = TruePath(alone.opened), FRAMES - 1
    found = path.at(alone.known_at(last), alone.history[last].placements, ended=True)
    assert not path.fixed and found is not None and found.scale == 1.0
    truth = alone.opened.truth
    assert truth is not None
    for time_ns, place in positions(alone, "tags").items():
        pose = truth.at(time_ns)
        assert pose is not None and np.linalg.norm(found.apply(pose.translation) - place) < 0.1
    assert not any(alone.history[i].errors_m for i in range(FRAMES))


def test_beside_a_method_that_begins_at_the_start_it_is_placed_there_in_metres(with_pairs: CurrentRun) -> None:
    assert TruePath(with_pairs.opened).fixed
    assert with_pairs.history[FRAMES - 1].placements["tags"].scale == 1.0
    errors = [found["tags"] for i in range(FRAMES) if "tags" in (found := with_pairs.history[i].errors_m)]
    assert len(errors) > FRAMES / 3 and max(errors) < 0.2
