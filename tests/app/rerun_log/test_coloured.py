"""Tracks on images by age, residual and depth: what is logged, and which of it is shown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ispom_app.engine.events import Opened, blank
from ispom_app.engine.inspection.colouring import BINS, COLOURINGS, SCALES
from ispom_app.engine.inspection.knowledge import known_from
from ispom_app.engine.inspection.sightings import seen_before
from ispom_app.views.rerun.batch import Entry
from ispom_app.views.rerun.blueprint import hidden_paths
from ispom_app.views.rerun.recorder import Recorder

from ispom.methods import Config
from ispom.types import TrackStatus
from tests import doubles
from tests.app.inspect.scene import COUNT, RIG, records

RECORDS = records()


def recorded(*, without: int = -1) -> list[dict[str, Entry]]:
    """By frame and path; one of the frames comes without its image."""
    sequence = replace(doubles.sequence(COUNT), rig=RIG)
    recorder = Recorder(Opened(sequence, ("monocular",), Config(), None))
    found = []
    for record in RECORDS:
        event = record.stepped(blank(sequence, 0) if record.index == without else sequence[0])
        found.append({e.path: e for e in recorder.batch(event).entries if isinstance(e, Entry)})
    return found


@pytest.mark.parametrize("by", SCALES)
def test_living_tracks_are_coloured_as_in_the_pages_own_picture(by):
    views = list(reversed(list(seen_before(RECORDS, COUNT - 1))))
    tracks, known = views[-1].tracks, known_from(views, RIG)
    entry = recorded()[-1][f"video/coloured/{by}"]
    classes = np.asarray(entry.value.class_ids.as_arrow_array())
    expected = known.bins(tracks, by)[tracks.status < TrackStatus.LOST]
    assert classes.tolist() == expected.tolist() and len(set(classes.tolist()) - {BINS}) >= (by != "residual")


def test_an_exposure_without_an_image_counts_for_the_age():
    whole, gap = recorded(), recorded(without=4)
    assert "video/image" not in gap[4] and "video/coloured/age" in gap[4], "the image may still come"
    last = [np.asarray(r[-1]["video/coloured/age"].value.class_ids.as_arrow_array()).tolist() for r in (whole, gap)]
    assert last[0] == last[1]


@pytest.mark.parametrize("by", COLOURINGS)
def test_one_way_to_colour_is_shown_at_a_time(by):
    hidden = {path.split("/overrides/")[1].removesuffix("/visualizers") for path in hidden_paths(("stereo",), (), by)}
    ways = {"state": "left/tracks", **{each: f"left/coloured/{each}" for each in SCALES}}
    assert {way for way, path in ways.items() if path not in hidden} == {by}
    legends = {"video/legend", *(f"video/coloured/{each}/legend" for each in SCALES)}
    assert legends | {f"{each}/{ink}" for each in legends for ink in ("words", "dark", "light")} <= hidden, (
        "the page has its own"
    )


def test_hidden_tracks_are_hidden_however_they_are_coloured():
    hidden = " ".join(hidden_paths(("stereo",), {"tracks"}, "age"))
    assert "left/tracks/" in hidden and "left/coloured/age" in hidden


def test_layers_are_hidden_in_the_images_of_all_cameras():
    hidden = {path.split("/overrides/")[1] for path in hidden_paths(("multicamera",), {"tracks"}, cameras=("front",))}
    assert {"camera/front/tracks/visualizers", "video/tracks/visualizers"} <= hidden
    assert "camera/front/lines/visualizers" not in hidden
