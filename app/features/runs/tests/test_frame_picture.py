"""The image of a frame with the tracks of a method drawn on it."""

from __future__ import annotations

import numpy as np
from ispom_app.engine.playback import Playback
from ispom_app.features.runs.frame_picture import picture, tracks_of
from ispom_app.presentation import colours
from ispom_app.session.current_run import CurrentRun

from ispom.types import Tracks
from tests import doubles
from tests.alone import METHODS
from tests.app import helpers


def test_tracks_are_drawn_where_they_are_in_the_colour_of_their_status() -> None:
    image = np.full((60, 80), 128, np.uint8)
    drawn = picture(image, Tracks.of(np.arange(3), np.array([[10.0, 20.0], [40.0, 30.0], [np.nan, 1.0]])))
    assert drawn.shape == (480, 640, 3)
    at = [(round((v + 0.5) * 8 - 0.5), round((u + 0.5) * 8 - 0.5)) for u, v in ((10.0, 20.0), (40.0, 30.0))]
    assert all(tuple(drawn[place]) == colours.TRACK[0] for place in at)  # type: ignore[index]
    assert (picture(image, None) == 128).all()


def test_the_tracks_are_those_of_the_method_or_of_what_it_builds_on() -> None:
    run = CurrentRun(Playback(doubles.sequence(20), METHODS, builder=helpers.build), 10**8)
    while len(run.history) < 13:
        run.step()
    record = run.history[12]
    camera = "left" if record.kind == "stereo" else "video"
    method = record.steps[0].method
    assert tracks_of(record, method, camera) is record.steps[0].tracks[camera]
    assert tracks_of(record, "nobody", camera) is None
