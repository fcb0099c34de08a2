"""`integrated` has the pose of `stereo` at a pair; between pairs it is found from points of its window."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ispom_app.engine.playback import Playback
from ispom_app.features.blame.found import PoseBlame, pose_blames
from ispom_app.features.blame.view import method_blame

from ispom.methods import Config
from ispom.sequences import open_sequence
from ispom.types import Step, TrackStatus

PAIR, VIDEO = 34, 39


def before(frame: int) -> Playback:
    found = Playback(open_sequence("sim:tiny"), ("integrated",), Config())
    while found.position < frame:
        found.step()
    return found


@pytest.fixture(scope="module")
def playback() -> Playback:
    return before(VIDEO)


@pytest.fixture(scope="module")
def found(playback: Playback) -> PoseBlame:
    (of,) = pose_blames(playback, ("integrated",), {})
    return of


def without(playback: Playback, part: Step, ids: tuple[int, ...]) -> Step:
    """The step again, from a video frame in which these tracks are lost."""
    tracks, states = part.tracks["video"], playback.snapshot.states
    status = np.where(np.isin(tracks.ids, ids), TrackStatus.LOST, tracks.status).astype(tracks.status.dtype)
    seen = replace(part, tracks={**part.tracks, "video": replace(tracks, status=status)})
    estimator = playback.ensemble.members["integrated"].estimator
    return estimator.step(states["integrated"], playback.sequence[VIDEO], {"video": seen})[1]


def test_between_pairs_a_rerun_without_the_tracks_of_a_group_agrees(playback: Playback, found: PoseBlame) -> None:
    assert playback.sequence.kinds[VIDEO] == "video"
    assert not found.solver and found.by_known_points and found.changed_since < 1e-6
    groups = found.found.of("group")[:3]
    assert groups
    for each in groups:
        again = found.between(without(playback, found.step.parts[0], each.part.tracks))
        assert again is not None and np.linalg.norm(each.shift.position - again.position) < 0.2 * again.size


def test_its_tracks_are_those_of_the_method_that_follows_them(found: PoseBlame) -> None:
    assert found.tracked_by == "monocular" and found.tracks is not None
    ids = {number for each in found.found.of("group", "track") for number in each.part.tracks}
    assert ids <= set(found.tracks.ids.tolist())
    selected = [row.select for row in method_blame(found).rows if row.select]
    assert selected and all(each.split(":")[1] == "monocular" for each in selected)


def test_at_a_pair_the_answer_is_that_of_stereo() -> None:
    at = before(PAIR)
    assert at.sequence.kinds[PAIR] == "stereo"
    own, stereo = pose_blames(at, ("integrated", "stereo"), {})
    assert (own.solver, own.tracked_by) == ("stereo", "stereo") and not stereo.solver
    assert [each.part for each in own.listed()] == [each.part for each in stereo.listed()]


def test_an_answer_of_its_own_is_not_taken_from_stereo_where_stereo_is_not_followed() -> None:
    settings = Config().with_settings("integrated", replace(Config().of("integrated"), follow_stereo=False))
    apart = Playback(open_sequence("sim:tiny"), ("integrated",), settings)
    while apart.position < PAIR:
        apart.step()
    (own,) = pose_blames(apart, ("integrated",), {})
    assert not own.solver and own.changed_since > 0
