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
from ispom_app.views.viser.controls import ConfigForm, label_of

from ispom.methods import Config, names
from ispom.settings import Range
from tests import doubles
from tests.alone import PAPER


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


def test_every_kind_of_field_has_its_input(server: viser.ViserServer):
    form = ConfigForm(server.gui, Example())
    kinds = {name: type(handle).__name__ for name, handle in form._inputs.items()}
    assert kinds == {
        "choice": "GuiDropdownHandle",
        "flag": "GuiCheckboxHandle",
        "count": "GuiSliderHandle",
        "parallax_px": "GuiSliderHandle",
        "tolerance": "GuiNumberHandle",
        "free": "GuiNumberHandle",
    }
    assert form._inputs["parallax_px"].label == "parallax [px]"
    assert form._inputs["choice"].hint == "How."
    assert form.value == Example()


def test_values_go_both_ways(server: viser.ViserServer):
    heard: list[Example] = []
    form = ConfigForm(server.gui, Example(), heard.append)
    form._inputs["count"].value = 120
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
    panel = MethodsPanel(server.gui, session)
    panel.show(state)
    assert panel._text.content == APPLIED and [m for m, box in panel._on.items() if box.value] == list(PAPER)
    assert {name for name, folder in panel._folders.items() if folder.visible} == set(PAPER)
    panel._on["stereo"].value = True
    panel._forms["stereo"]._inputs["max_tracks"].value = 321
    assert panel._text.content == PENDING and panel._folders["stereo"].visible
    for press in panel._apply._impl.update_cb:
        press(SimpleNamespace())
    restart = commands[-1]
    assert isinstance(restart, do.Restart) and restart.methods == ("stereo", *PAPER)
    assert restart.config.of("stereo").max_tracks == 321
    panel._forms["stereo.paper"]._inputs["min_inliers"].value = 77
    session.state = replace(state, config=restart.config, methods=restart.methods, run=2)
    panel.show(session.state)
    assert panel._on["stereo"].value and panel._text.content == APPLIED


def test_more_methods_are_one_list_and_a_choice_has_a_box(server: viser.ViserServer):
    opened = SimpleNamespace(sequence=SimpleNamespace(rig=doubles.rig()))
    state = State("double:20", methods=("stereo",), run=1)
    session: Any = SimpleNamespace(state=state, opened=opened, post=lambda _: None)
    panel = MethodsPanel(server.gui, session)
    panel.show(state)
    boxes = [m for m, box in panel._on.items() if box.visible]
    assert boxes == list(ALWAYS) and label("lines") in panel._more.options
    assert not {label(m) for m in boxes} & set(panel._more.options)
    panel._add(label("lines"))
    assert panel._on["lines"].value and panel._on["lines"].visible and panel._folders["lines"].visible
    assert panel._more.value == MORE and label("lines") not in panel._more.options and panel._text.content == PENDING


def test_the_view_lists_the_methods_that_run(server: viser.ViserServer):
    state = State("double:20", methods=("stereo", "lines"), run=1)
    opened = SimpleNamespace(
        sequence=SimpleNamespace(rig=doubles.rig()), truth=None, external_trajectories=(), map=None
    )
    session: Any = SimpleNamespace(state=state, post=lambda _: None, opened=opened)
    panel = ViewPanel(server.gui, session)
    panel.show(state)
    assert [m for m in names() if panel._boxes[m].visible] == list(state.methods)
    assert all(label(m) in panel._legend.content for m in state.methods)
    assert label("monocular") not in panel._legend.content
    assert panel._boxes["disparity"].visible and panel._boxes["lines"].visible
    assert not any(panel._boxes[layer].visible for layer in ("truth", "error", "beside", "map"))
