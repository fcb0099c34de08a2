"""A/B flicker: one image with the tracks of one side at a time, and the 3-D view with its path and points alone."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import viser
from ispom_app.engine.playback import Playback
from ispom_app.features.branches.branches import Branch
from ispom_app.features.flicker.commands import Flick, FlickerBetween, StopFlicker
from ispom_app.features.flicker.flicker import Flicker, Side
from ispom_app.features.flicker.panel import OFF, TURN, FlickerPanel
from ispom_app.features.flicker.stage import side
from ispom_app.features.flicker.state import Flickering
from ispom_app.presentation import colours
from ispom_app.session import commands as do
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.state import State, reduce
from ispom_app.views.viser.track_picture import picture, tracks_of
from ispom_app.views.web.messages import message_of

from ispom.types import Tracks
from tests import doubles
from tests.alone import METHODS
from tests.app import helpers
from tests.app.helpers import with_values

A, B = Side(0, "stereo"), Side(1, "stereo")


@pytest.fixture(scope="module")
def run() -> CurrentRun:
    found = CurrentRun(Playback(doubles.sequence(20), METHODS, builder=helpers.build), 10**8)
    while not found.playback.done:
        found.step()
    return found


@pytest.fixture
def state(run: CurrentRun) -> State:
    branches = (Branch(0, "first run", computed=22), Branch(1, "fewer", 0, 9, (), 22))
    return with_values(reduce(State("double:20"), run.opened), branches=branches, displayed=run.history[12])


def made(server: viser.ViserServer, run: CurrentRun) -> tuple[FlickerPanel, list[do.Command]]:
    asked: list[do.Command] = []
    session: Any = SimpleNamespace(
        state=State("double:20"), post=asked.append, run=run, service=lambda _: SimpleNamespace(run_of=lambda _: run)
    )
    return FlickerPanel(server.gui, session), asked


def test_sides_are_chosen_and_turned_by_commands(server: viser.ViserServer, run: CurrentRun, state: State) -> None:
    panel, asked = made(server, run)
    panel.show(state)
    options = panel._choices["A"].options
    assert len(options) == 7 and "1 fewer: Stereo" in options
    panel._choices["A"].value = "0 first run: Stereo"
    assert not asked, "one side is not enough"
    panel._choices["B"].value = "1 fewer: Stereo"
    panel._buttons.value = TURN
    panel._buttons.value = OFF
    assert asked == [FlickerBetween(A, B), Flick(), StopFlicker()]


def test_one_picture_is_seen_at_a_time_and_the_panel_says_whose(
    server: viser.ViserServer, run: CurrentRun, state: State
) -> None:
    panel, asked = made(server, run)
    flicker = Flicker(A, replace(A, method="integrated"))
    panel.show(with_values(state, flicker=flicker))
    assert [panel._pictures[name].visible for name in "ab"] == [True, False]
    assert "drawn: <b>A</b>, 0 first run: Stereo" in panel._text.content
    before = panel._pictures["a"].image
    panel.show(with_values(state, flicker=flicker.turned))
    assert [panel._pictures[name].visible for name in "ab"] == [False, True]
    assert "drawn: <b>B</b>, 0 first run: Integrated" in panel._text.content
    assert panel._pictures["a"].image is before, "nothing is drawn or sent again"
    panel.show(state)
    assert not any(each.visible for each in panel._pictures.values()) and not asked


def test_a_source_that_is_gone_is_said_instead(server: viser.ViserServer, run: CurrentRun, state: State) -> None:
    from ispom.errors import InputError

    def gone(index: int) -> None:
        raise InputError("the images are gone")

    panel, _ = made(server, run)
    sequence = replace(run.playback.sequence, load=gone)  # type: ignore[arg-type]
    panel._session.run = SimpleNamespace(playback=SimpleNamespace(sequence=sequence))  # type: ignore[misc]
    panel.show(with_values(state, flicker=Flicker(A, B)))
    assert "the images are gone" in panel._text.content and not panel._pictures


def test_tracks_are_drawn_where_they_are_in_the_colour_of_their_status() -> None:
    image = np.full((60, 80), 128, np.uint8)
    drawn = picture(image, Tracks.of(np.arange(3), np.array([[10.0, 20.0], [40.0, 30.0], [np.nan, 1.0]])))
    assert drawn.shape == (480, 640, 3)
    at = [(round((v + 0.5) * 8 - 0.5), round((u + 0.5) * 8 - 0.5)) for u, v in ((10.0, 20.0), (40.0, 30.0))]
    assert all(tuple(drawn[place]) == colours.TRACK[0] for place in at)  # type: ignore[index]
    assert (picture(image, None) == 128).all()


def test_the_tracks_are_those_of_the_method_or_of_what_it_builds_on(run: CurrentRun) -> None:
    record = run.history[12]
    camera = "left" if record.kind == "stereo" else "video"
    method = record.steps[0].method
    assert tracks_of(record, method, camera) is record.steps[0].tracks[camera]
    assert tracks_of(record, "nobody", camera) is None


def test_a_side_has_its_path_points_and_camera(run: CurrentRun) -> None:
    drawn = {entry.path: entry.value for entry in side("a", A, run, 99)}
    assert set(drawn) == {f"world/flicker/a/{part}" for part in ("path", "cloud", "camera")}
    (path,) = drawn["world/flicker/a/path"].strips.as_arrow_array().to_pylist()  # type: ignore[attr-defined]
    model = run.known_at(len(run.history) - 1)
    poses = model.methods["stereo"].poses.trajectory(model.times)
    assert np.allclose(path, poses.translations, atol=1e-5), "as known last"


def test_a_turn_only_hides_the_other_side(state: State) -> None:
    def hidden(flicker: Flicker) -> str:
        return " ".join(message_of(state.having(Flickering(flicker)))["hidden"])

    first, second = hidden(Flicker(A, B)), hidden(Flicker(A, B).turned)
    assert "world/flicker/b/" in first and "world/flicker/a/" not in first
    assert "world/flicker/a/" in second and "world/flicker/b/" not in second
    assert all("world/stereo/" in each for each in (first, second)), "what is drawn else is in the way"
