"""The Look tab: what it shows of a run that says all, and what it asks of the session. No browser."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import viser
from ispom_app.engine.inspection.looked import Looked
from ispom_app.engine.inspection.selection import parsed
from ispom_app.engine.playback import Playback
from ispom_app.features.layers.commands import ColourBy
from ispom_app.features.tracks import panel as looks
from ispom_app.features.tracks.commands import LookAt
from ispom_app.features.tracks.geometry import geometry_report
from ispom_app.features.tracks.key_frames import key_frames_report
from ispom_app.features.tracks.panel import EMPTY, LookTab
from ispom_app.features.tracks.residuals import residuals_report
from ispom_app.features.tracks.stage import ROOT, in_images, in_world
from ispom_app.features.tracks.track import CHIP_PX, MOST_KEPT, TrackChips, cut, spread, track_report
from ispom_app.features.tracks.track_picture import track_picture
from ispom_app.features.tracks.tracks import lifetimes_chart, tracks_table
from ispom_app.session import commands as do
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.state import Computed, State, reduce
from ispom_app.views.rerun import entities

from ispom.errors import InputError, UnreadableImage
from ispom.types import Rig, Tracks
from tests import doubles
from tests.alone import METHODS
from tests.app.gui import Gui
from tests.app.helpers import run_to_end, with_values

N = 40


class Steady(doubles.FullEstimator):
    """Its tracks stay the same from one frame to the next."""

    def step(self, state: tuple[int, ...], exposure: Any, asked: object = None) -> Any:
        after, step = super().step(state, exposure)
        ids = np.arange(30, dtype=np.int64)
        tracks = {camera: replace(t, ids=ids, status=np.zeros(30, np.uint8)) for camera, t in step.tracks.items()}
        return after, replace(step, tracks=tracks, landmarks=replace(step.landmarks, ids=ids))


def computed(estimator: Any) -> CurrentRun:
    playback = Playback(
        doubles.sequence(N), METHODS, builder=lambda config, methods, rig: doubles.ensemble(methods, estimator)
    )
    return run_to_end(playback)


@pytest.fixture(scope="module")
def run() -> CurrentRun:
    return computed(Steady)


def state_of(run: CurrentRun, **values: object) -> State:
    state = reduce(State("double:40"), run.opened)
    for record in run.history:
        state = reduce(state, Computed(record, run.tally))
    return with_values(state, **values)


def looked(run: CurrentRun, selected: str = "", camera: str = "video", **values: Any) -> Looked:
    record = run.history[values.pop("index", N - 1)]
    by = values.pop("colour_by", "state")
    sequence = values.pop("sequence", run.opened.sequence)
    return Looked(sequence, run.history, run.series, run.known_at, record, parsed(selected), camera, by)


@pytest.mark.parametrize("camera", ["video", "left"])
@pytest.mark.parametrize("by", ["state", "age", "residual", "depth"])
def test_the_picture_has_its_tracks_and_says_what_their_colours_mean(run: CurrentRun, camera: str, by: str):
    shown = looked(run, camera=camera, colour_by=by)
    text = track_picture(shown)
    assert f'data-pick="{camera}" data-index="{shown.index}"' in text and text.count("h0") >= 30
    assert "median" in text if by == "depth" else by == "state" or f"{by}" in text


def test_the_picture_is_the_cameras_latest_up_to_the_exposure_shown(run: CurrentRun):
    shown = looked(run, camera="left", index=9)
    assert shown.index is not None and shown.index <= 9 and run.history[shown.index].kind == "stereo"


def test_an_image_that_cannot_be_read_again_is_reported(run: CurrentRun):
    def load(i: int) -> Any:
        raise UnreadableImage("gone")

    sequence = replace(run.opened.sequence, load=load)
    shown = looked(run, "track:monocular:5", sequence=sequence)
    assert "no image" in track_picture(shown)
    assert "Track 5" in track_report(shown, TrackChips())


def test_a_recording_alone_has_neither_images_nor_tracks(run: CurrentRun):
    def load(i: int) -> Any:
        raise InputError("nothing is there")

    sequence = replace(run.opened.sequence, rig=Rig(), load=load)
    bare = [replace(record, steps=()) for record in run.history]
    shown = Looked(sequence, bare, run.series, run.known_at, bare[9], parsed("track:stereo:5"), "", "age")
    for panel in (track_picture, tracks_table, lifetimes_chart, key_frames_report, residuals_report, geometry_report):
        assert panel(shown)
    assert "not among" in track_report(shown, TrackChips())


def test_a_track_has_chips_point_and_residuals(run: CurrentRun):
    shown = looked(run, "track:monocular:5")
    text = track_report(shown, TrackChips())
    assert text.count("data-seek=") == 12 and "landmark of frame" in text and "from the line" in text
    assert "1 sigma" in text and "RMS" in text


def test_a_track_of_a_part_alone_is_found_as_well(run: CurrentRun):
    assert looked(run, "track:monocular:5").life is not None
    assert "not among" in track_report(looked(run, "track:monocular:999"), TrackChips())
    assert "click" in track_report(looked(run), TrackChips())


def test_chips_are_spread_over_the_life_and_few_are_kept(run: CurrentRun):
    shown, chips = looked(run, "track:monocular:5"), TrackChips()
    assert shown.life is not None
    places = spread(shown.life)
    assert places[0] == 0 and places[-1] == len(shown.life.observations) - 1 and len(places) == 12
    for number in range(12):
        track_report(looked(run, f"track:monocular:{number}"), chips)
    assert len(chips._pictures) == MOST_KEPT


def test_a_chip_at_the_edge_repeats_it():
    image = np.arange(100 * 80, dtype=np.uint32).reshape(80, 100).astype(np.uint8)
    found = cut(image, np.array([2.0, 79.0]))
    assert found.shape == (CHIP_PX, CHIP_PX) and found[CHIP_PX // 2, CHIP_PX // 2] == image[79, 2]


def test_rows_lines_and_cells_can_be_selected(run: CurrentRun):
    shown = looked(run, "key_frame:monocular:0")
    assert tracks_table(shown).count('data-select="track:monocular:') == 30
    assert lifetimes_chart(shown).count('data-select="track:monocular:') == 30
    text = key_frames_report(shown)
    assert 'data-select="key_frame:monocular:' in text and "Keyframe 0" in text and "30 shared tracks" in text
    assert "95 % below" in residuals_report(shown)
    text = geometry_report(shown)
    assert "T13" in text and "baseline" in text and "400 mm" in text


def test_without_tracks_each_panel_says_so():
    class Blind(doubles.FakeEstimator):
        def step(self, state: tuple[int, ...], exposure: Any, asked: object = None) -> Any:
            after, step = super().step(state, exposure)
            none = Tracks.of(np.zeros(0), np.zeros((0, 2)))
            return after, replace(step, tracks=dict.fromkeys(step.tracks, none), key_frame=False)

    shown = looked(computed(Blind))
    for panel in (track_picture, tracks_table, lifetimes_chart, key_frames_report, residuals_report):
        assert panel(shown)


class Asked:
    def __init__(self, run: CurrentRun) -> None:
        self.run, self.asked = run, list[do.Command]()
        self.post = self.asked.append


def test_controls_post_changes_and_follow_without_posting(server: viser.ViserServer, run: CurrentRun):
    session = Asked(run)
    gui: Any = Gui(server)
    tab = LookTab(gui, session)  # type: ignore[arg-type]
    colour_by, panel = gui.labelled("colour by"), gui.labelled("show")
    tab.show(state_of(run, colour_by="depth", look="residuals"))
    assert not session.asked and (colour_by.value, panel.value) == ("depth", "residuals")
    panel.value, colour_by.value, gui.labelled("image").value = "tracks", "age", "left image"
    assert session.asked == [LookAt(panel="tracks"), ColourBy("age"), LookAt(camera="left")]


def test_it_is_drawn_when_something_changed_and_at_most_once_a_second_while_playing(
    server: viser.ViserServer, run: CurrentRun, monkeypatch: pytest.MonkeyPatch
):
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(looks, "time", SimpleNamespace(monotonic=lambda: clock.now))
    gui: Any = Gui(server)
    tab, state = LookTab(gui, Asked(run)), state_of(run, playing=True)  # type: ignore[arg-type]
    picture = gui.every("html")[0]
    tab.refresh(with_values(state, displayed=None))
    assert picture.content == EMPTY
    clock.now += 2
    tab.refresh(state)
    first = picture.content
    assert "data-pick" in first
    tab.refresh(with_values(state, displayed=run.history[20]))
    assert picture.content == first
    tab.refresh(with_values(state, displayed=run.history[20], playing=False))
    assert picture.content != first


def test_the_3d_view_has_the_selected_track_and_the_layer_only_where_wanted(run: CurrentRun):
    paths = {entry.path for entry in in_world(looked(run, "track:stereo:5", "left"), geometry=False)}
    assert paths == {f"{ROOT}/track/{part}" for part in ("rays", "point", "region")}
    paths = {entry.path for entry in in_world(looked(run), geometry=True)}
    assert {f"{ROOT}/{of}/cameras" for of in ("triple", "pair")} <= paths
    assert not any("track" in path for path in paths)


def test_the_selected_track_has_a_ring_in_its_image(run: CurrentRun):
    shown = looked(run, "track:stereo:5", "left")
    (entry,) = in_images(shown)
    index = max(i for i in range(shown.record.index + 1) if run.opened.sequence.kinds[i] == "stereo")
    tracks = next(step for step in run.history[index].steps if step.method == "stereo").tracks["left"]
    ring = np.array(entry.value.strips.as_arrow_array().to_pylist()[0])  # type: ignore[attr-defined]
    at = entities.shown_uv(tracks.uv[tracks.ids == 5], run.opened.sequence.rig.camera("left"))
    assert entry.path == "left/selected" and np.allclose(ring[:-1].mean(0), at[0], atol=1e-3)
    assert not list(in_images(looked(run, "key_frame:stereo:5")))
