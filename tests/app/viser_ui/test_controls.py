"""Inputs made from a config dataclass, and back. viser without a browser: setting a value calls the callbacks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Annotated, Any, Literal

import pytest
import viser
from ispom_app.features.layers.panel import ViewPanel
from ispom_app.features.methods.panel import ALWAYS, APPLIED, MORE, PENDING, MethodsPanel
from ispom_app.presentation.colours import label
from ispom_app.session import commands as do
from ispom_app.session.state import State
from ispom_app.views.rerun.layers import LAYERS
from ispom_app.views.viser.controls import ConfigForm, label_of

from ispom.methods import Config, names
from ispom.settings import Range
from tests import doubles
from tests.alone import PAPER
from tests.app.gui import Gui, press


@dataclass(frozen=True)
class Example:
    choice: Literal["norm", "vector"] = "norm"
    """How."""
    flag: bool = False
    """Whether."""
    count: Annotated[int, Range(50, 2000)] = 400
    """How many."""
    parallax_px: Annotated[float, Range(1, 200)] = 12.0
    """How far."""
    tolerance: Annotated[float, Range(1e-9, 1.0)] = 1e-6
    free: float = 0.5


def box(gui: Gui, method: str) -> viser.GuiCheckboxHandle:
    """Switches the method on."""
    return gui.labelled(label(method), "checkbox")


def settings_of(gui: Gui, method: str) -> tuple[Any, dict[str, Any]]:
    """The folder of a method's settings, and its inputs by their labels."""
    return gui.folder(f"{label(method)} settings")


def test_every_kind_of_field_has_its_input(server: viser.ViserServer):
    gui: Any = Gui(server)
    form = ConfigForm(gui, Example())
    labels = {"choice": "dropdown", "flag": "checkbox", "count": "slider", "parallax [px]": "slider"}
    for name, kind in (labels | {"tolerance": "number", "free": "number"}).items():
        assert gui.labelled(name, kind).visible
    assert gui.labelled("choice").hint == "How."
    assert form.value == Example()


def test_values_go_both_ways(server: viser.ViserServer):
    heard: list[Example] = []
    gui: Any = Gui(server)
    form = ConfigForm(gui, Example(), heard.append)
    gui.labelled("count").value = 120
    assert heard == [Example(count=120)]
    form.show(Example(choice="vector", flag=True))
    assert form.value == Example(choice="vector", flag=True)
    assert len(heard) == 1, "showing is not changing"


def test_the_real_settings_survive_the_round_trip(server: viser.ViserServer):
    for config in map(Config().of, names()):
        assert ConfigForm(server.gui, config).value == config


@pytest.mark.parametrize(
    ("name", "label"), [("min_parallax_px", "min parallax [px]"), ("max_tracks", "max tracks"), ("px", "px")]
)
def test_labels_carry_units(name: str, label: str):
    assert label_of(name) == label


def test_the_methods_panel_offers_all_methods_together(server: viser.ViserServer):
    commands: list[do.Command] = []
    opened = SimpleNamespace(sequence=SimpleNamespace(rig=doubles.rig()))
    state = State("double:20", methods=PAPER, run=1)
    session: Any = SimpleNamespace(state=state, opened=opened, post=commands.append)
    gui: Any = Gui(server)
    panel = MethodsPanel(gui, session)
    panel.show(state)
    assert gui.text == APPLIED and [m for m in names() if box(gui, m).value] == list(PAPER)
    assert {name for name in names() if settings_of(gui, name)[0].visible} == set(PAPER)
    box(gui, "stereo").value = True
    settings_of(gui, "stereo")[1]["max tracks"].value = 321
    assert gui.text == PENDING and settings_of(gui, "stereo")[0].visible
    press(gui.labelled("Apply and restart"))
    restart = commands[-1]
    assert isinstance(restart, do.Restart) and restart.methods == ("stereo", *PAPER)
    assert restart.config.of("stereo").max_tracks == 321
    settings_of(gui, "stereo.paper")[1]["min inliers"].value = 77
    session.state = replace(state, config=restart.config, methods=restart.methods, run=2)
    panel.show(session.state)
    assert box(gui, "stereo").value and gui.text == APPLIED


def test_more_methods_are_one_list_and_a_choice_has_a_box(server: viser.ViserServer):
    opened = SimpleNamespace(sequence=SimpleNamespace(rig=doubles.rig()))
    state = State("double:20", methods=("stereo",), run=1)
    session: Any = SimpleNamespace(state=state, opened=opened, post=lambda _: None)
    gui: Any = Gui(server)
    panel = MethodsPanel(gui, session)
    panel.show(state)
    methods, more = {label(m) for m in names()}, gui.labelled("More methods")
    boxes = [c.label for c in gui.every("checkbox") if c.visible and c.label in methods]
    assert boxes == [label(m) for m in ALWAYS] and label("lines") in more.options
    assert not set(boxes) & set(more.options)
    more.value = label("lines")
    assert box(gui, "lines").value and box(gui, "lines").visible and settings_of(gui, "lines")[0].visible
    assert more.value == MORE and label("lines") not in more.options and gui.text == PENDING


def test_the_view_lists_the_methods_that_run(server: viser.ViserServer):
    state = State("double:20", methods=("stereo", "lines"), run=1)
    opened = SimpleNamespace(
        sequence=SimpleNamespace(rig=doubles.rig()), truth=None, external_trajectories=(), map=None
    )
    session: Any = SimpleNamespace(state=state, post=lambda _: None, opened=opened)
    gui: Any = Gui(server)
    panel = ViewPanel(gui, session)
    panel.show(state)
    assert [m for m in names() if box(gui, m).visible] == ["stereo", "lines"] and not LAYERS.keys() & set(names())
    assert all(label(m) in gui.text for m in state.methods)
    assert label("monocular") not in gui.text
    assert gui.labelled(LAYERS["disparity"]).visible and gui.labelled(LAYERS["overlay"]).visible
    assert not any(gui.labelled(LAYERS[layer]).visible for layer in ("truth", "error", "beside", "map"))
