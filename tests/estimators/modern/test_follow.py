"""Of two rigid motions the one is followed that the setting says, whichever has more tracks."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.estimators.modern.monocular.estimator import ModernMonocular, ModernMonocularConfig
from ispom.estimators.modern.second_motion import Follow, Moving, preferred
from ispom.estimators.modern.stereo.estimator import ModernStereo, ModernStereoConfig
from ispom.geometry import Array, Pose
from ispom.types import Camera, Frame, Image, Rig, Step
from tests.estimators.modern.waved_card import FX, LARGE, LARGER, SIZE, leaving

BASELINE_M = 0.3
CAMERA = Camera(SIZE[1], SIZE[0], FX, FX, SIZE[1] / 2, SIZE[0] / 2)
RIG = Rig.of(video=CAMERA, left=CAMERA, right=CAMERA, rig_from_right=Pose(np.eye(3), np.array([BASELINE_M, 0.0, 0.0])))
STILL, STEP_M = 8, 0.05


def left_at(i: int) -> Pose:
    """camera_from_world: sideways."""
    return Pose(np.eye(3), np.array([0.5 - STEP_M * i, 0.0, 0.0]))


def by_pairs(follow: Follow, moves: list[int], card: Image) -> list[Step]:
    estimator = ModernStereo(RIG, ModernStereoConfig(follow=follow))
    state, steps = estimator.start(), []
    for i, moved in enumerate(moves):
        left = left_at(i)
        right = RIG.rig_from_right.inverse() @ left
        pair = Frame.stereo(i * 100_000_000, leaving(left, moved, card), leaving(right, moved, card))
        state, step = estimator.step(state, pair)
        steps.append(step)
    return steps


def errors_m(steps: list[Step]) -> Array:
    """(N,) of the places, in a world that stands still."""
    places = np.array([s.world_from_frame.translation for s in steps if s.world_from_frame is not None])
    assert len(places) == len(steps)
    return np.linalg.norm(places - [[STEP_M * i, 0.0, 0.0] for i in range(len(steps))], axis=1)


LEAVES = [max(i - STILL, 0) for i in range(18)]
COMES = [22 - i for i in range(22)]


@pytest.mark.parametrize(("moves", "card"), [(LEAVES, LARGE), (COMES, LARGER)], ids=["leaves", "comes"])
def test_a_pair_stays_with_what_stands_still_where_most_of_the_image_moves(moves: list[int], card: Image) -> None:
    static = by_pairs("static", moves, card)
    assert errors_m(static).max() < 0.005
    asked = [d for s in static for d in s.decisions if d.key == "other_wider"]
    assert any(d.passed for d in asked), "it was not the motion of most points"
    largest = by_pairs("largest", moves, card)
    assert errors_m(largest).max() > 0.2
    assert all(d.key != "other_wider" for s in largest for d in s.decisions)


def test_the_tracks_told_of_are_those_that_are_not_followed() -> None:
    steps = by_pairs("static", LEAVES, LARGE)
    step = next(s for s in steps if any(d.key == "other_wider" and d.passed for d in s.decisions))
    assert step is steps[STILL + 1], "as soon as it moves"
    told, tracks = step.other_motion["left"], step.tracks["left"]
    assert np.mean(np.abs(told.uv[:, 0] - SIZE[1] / 2) < 125) > 0.95 and np.mean(told.uv[:, 1] < 175) > 0.95
    assert set(told.ids) <= set(tracks.ids[tracks.status != 0])


def filmed(follow: Follow) -> list[Step]:
    """A card comes before a camera until it fills most of the image."""
    estimator = ModernMonocular(RIG, ModernMonocularConfig(max_tracks=300, follow=follow))
    state, steps = estimator.start(), []
    for i in range(66):
        pose = Pose(np.eye(3), np.array([0.5 - 0.025 * i, 0.0, 0.0]))
        state, step = estimator.step(state, Frame.video(i * 50_000_000, leaving(pose, (70 - i) // 2, LARGER)))
        steps.append(step)
    return steps


def test_one_camera_begins_a_new_map_of_what_fills_more_of_the_image_only_where_that_is_wanted() -> None:
    static, largest = filmed("static"), filmed("largest")
    assert not any(s.restarted for s in static)
    (at,) = [i for i, s in enumerate(largest) if s.restarted]
    assert any(d.key == "other_larger" and d.passed for d in largest[at].decisions)
    for a, b in zip(static[:at], largest[:at], strict=True):
        assert a.world_from_frame is not None and b.world_from_frame is not None
        np.testing.assert_array_equal(a.world_from_frame.translation, b.world_from_frame.translation)
    moved = [s.world_from_frame.translation for s in static[at:] if s.world_from_frame is not None]
    way = np.diff(np.array(moved), axis=0)
    assert len(moved) == len(static) - at
    assert (way[:, 0] > 5 * np.abs(way[:, 1:]).max(axis=1)).all(), "sideways, as it moves before the walls"


def moving(first_id: int, width: float, columns: int, count: int = 40) -> Moving:
    """Points in the first `columns` of the 100 columns of an image, in a scene of `width`."""
    rng = np.random.default_rng(first_id)
    uv = rng.uniform((0, 0), (columns, 80), (count, 2)).astype(np.float32)
    return Moving(first_id + np.arange(count), uv, rng.uniform(0, width, (count, 3)))


@pytest.mark.parametrize(
    ("follow", "other", "own", "expected"),
    [
        ("static", moving(0, 4, 20), moving(0, 1, 90), True),
        ("static", moving(0, 1, 90), moving(0, 4, 20), False),
        ("static", moving(0, 1.2, 90), moving(0, 1, 20), False),
        ("static", moving(500, 40, 90), moving(0, 1, 20), False),
        ("static", moving(0, 1, 20), moving(500, 40, 90), True),
        ("largest", moving(500, 1, 90), moving(0, 4, 20), True),
        ("largest", moving(0, 40, 20), moving(500, 1, 90), False),
    ],
    ids=["wider", "narrower", "as wide", "came later", "was before", "larger", "smaller"],
)
def test_preferred(follow: Follow, other: Moving, own: Moving, expected: bool) -> None:
    assert preferred(follow, other, own, (100, 80)).passed is expected
