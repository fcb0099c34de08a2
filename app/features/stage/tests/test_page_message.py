"""What a page is sent of the places of the eye: the whole path is framed again only where it is needed."""

from __future__ import annotations

import numpy as np
from ispom_app.features.stage.page_message import StageNews
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.state import State, reduce

from tests.app.helpers import with_values


def state_at(run: CurrentRun, index: int) -> State:
    return with_values(reduce(State("double:40"), run.opened), displayed=run.history[index])


def test_the_path_so_far_is_framed_and_again_where_it_left_that(run: CurrentRun):
    news, framed = StageNews(), 0
    for index in range(len(run.history)):
        found = news.since(state_at(run, index), run)
        framed += found is not None and "frame" in found
    assert 1 <= framed < len(run.history) / 3


def test_what_a_page_has_is_not_sent_again(run: CurrentRun):
    news, state = StageNews(), state_at(run, 30)
    first = news.since(state, run)
    assert first is not None and {"eye", "share", "curves", "frame", "top", "side", "camera", "follow"} == set(first)
    assert news.since(state, run) is None
    later = news.since(state_at(run, 31), run)
    assert later is not None and set(later) <= {"frame", "top", "side", "camera", "follow"}


def test_the_eye_of_the_camera_is_where_the_method_has_it(run: CurrentRun):
    found = StageNews().since(state_at(run, 30), run)
    steps = [s for i in range(31) for s in run.history[i].steps if s.method == "integrated" and s.world_from_frame]
    pose, rig = steps[-1].world_from_frame, run.opened.sequence.rig
    assert found is not None and pose is not None
    wanted = pose @ rig.rig_from(steps[-1].frame).inverse() @ rig.rig_from("video")
    assert np.allclose(found["camera"][0], wanted.translation, atol=1e-4)


def test_without_a_run_there_is_nothing_to_frame(run: CurrentRun):
    assert StageNews().since(State("double:40"), None) is None
    assert StageNews().since(reduce(State("double:40"), run.opened), run) is None
