"""What a page is sent of the places of the eye: the whole path is framed again only where it is needed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from ispom_app.features.stage.page_message import StageNews
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.state import State, reduce

from tests.app.helpers import with_values


def state_at(run: CurrentRun, index: int) -> State:
    return with_values(reduce(State("double:40"), run.opened), displayed=run.history[index])


def frames_the_eye_was_put_at(run: CurrentRun, state: Callable[[int], State]) -> list[int]:
    news = StageNews()
    found = [(index, news.since(state(index), run)) for index in range(len(run.history))]
    return [index for index, sent in found if sent is not None and "frame" in sent]


def without_truth(state: State) -> State:
    return with_values(state, hidden=frozenset({"truth"}))


def test_the_path_so_far_is_framed_and_again_where_it_left_that(run: CurrentRun):
    framed = frames_the_eye_was_put_at(run, lambda index: without_truth(state_at(run, index)))
    assert 1 <= len(framed) < len(run.history) / 3


def test_the_true_path_is_framed_from_the_first_frame_on(run: CurrentRun):
    assert frames_the_eye_was_put_at(run, lambda index: state_at(run, index)) == [0]


def test_the_view_is_put_again_when_the_true_path_is_hidden(run: CurrentRun):
    news, state = StageNews(), state_at(run, 5)
    with_truth = news.since(state, run)
    alone = news.since(without_truth(state), run)
    assert with_truth is not None and alone is not None
    assert with_truth["frame"] != alone["frame"]


def test_what_a_page_has_is_not_sent_again(run: CurrentRun):
    news, state = StageNews(), state_at(run, 30)
    first = news.since(state, run)
    assert first is not None and {"eye", "layout", "frame", "top", "side", "camera", "follow"} == set(first)
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
