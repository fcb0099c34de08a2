"""Answers: what is one, and which are right."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from ispom_app.engine.conditions.parser import parse
from ispom_app.features.lessons.lesson import TRACK, Ask, Choose, Draw, Fact, Number, Option, Point, right_tracks
from ispom_app.features.lessons.reveal import SAMPLES, Revealed, accepted, is_right

from ispom.types import Rig, Tracks, TrackStatus
from tests import doubles

FAR = parse("track.depth_m > 20", TRACK)
CHOOSE, NUMBER, POINT = Choose((Option("a", FAR), Option("b", FAR))), Number("v", "m", 0.1), Point("left", FAR)
DRAW = Draw(Fact("step_scale_curve", "this", ("stereo",)), "x", "y", (0.0, 10.0), (0.0, 1.0), 0.05)


@pytest.mark.parametrize("ask", [CHOOSE, NUMBER, POINT, DRAW])
@pytest.mark.parametrize(
    "given", [None, True, "1", -1.5, math.nan, math.inf, {}, [], [1.0], [math.nan] * SAMPLES, ["1"] * SAMPLES, 99]
)
def test_what_is_no_answer_is_ignored(ask: Ask, given: Any):
    if isinstance(ask, Number) and given in (-1.5, 99):
        assert accepted(ask, given) == given
    else:
        assert accepted(ask, given, [3, 5]) is None


def test_a_choice_and_a_track_are_right_where_their_condition_holds():
    found = Revealed({}, frozenset({1, 5}))
    assert accepted(CHOOSE, 1) == 1 and is_right(CHOOSE, found, 1) and not is_right(CHOOSE, found, 0)
    assert accepted(POINT, 5, [3, 5]) == 5 and is_right(POINT, found, 5) and not is_right(POINT, found, 3)


def test_a_number_is_right_within_its_tolerance():
    found = Revealed({"v": 20.0})
    assert is_right(NUMBER, found, 20.09) and not is_right(NUMBER, found, 20.2)
    share = Number("v", "m", 0.0, 10.0)
    assert is_right(share, found, 18.1) and not is_right(share, found, 17.9)


def test_a_curve_is_right_where_it_is_near_on_average_within_the_chart():
    found = Revealed({}, curve=(np.array([0.0, 5.0, 10.0]), np.array([0.0, 0.5, 9.0])))
    shown = np.clip(np.interp(np.linspace(0, 10, SAMPLES), [0, 5, 10], [0, 0.5, 9]), 0, 1)
    assert accepted(DRAW, shown.tolist()) == tuple(shown)
    assert is_right(DRAW, found, tuple(shown + 0.04)) and not is_right(DRAW, found, tuple(shown + 0.06))


def test_tracks_are_inspected_for_depth_motion_and_why_they_ended():
    rig: Rig = doubles.rig()  # focal length 120 px, baseline 0.4 m
    tracks = Tracks.of(
        np.arange(3),
        np.array([[5.0, 5.0], [8.0, 5.0], [5.0, 9.0]]),
        uv_prev=np.full((3, 2), 5.0),
        status=np.array([TrackStatus.ALIVE, TrackStatus.RIGID, TrackStatus.OUT_OF_IMAGE]),
        disparity_px=np.array([2.0, 4.0, np.nan]),
    )
    expected_of = {"depth_m > 20": [1, 0, 0], "moved_px > 3.5": [0, 0, 1], "disagrees": [0, 1, 0], "dropped": [0, 1, 1]}
    for text, right in expected_of.items():
        assert right_tracks(tracks, rig, parse(f"track.{text}", TRACK)).tolist() == [bool(r) for r in right]
