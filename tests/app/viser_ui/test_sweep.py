"""The panel of sweeps: what it asks for, and what it shows of a sweep; and the points of its plot."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import viser
from ispom_app.engine.options import SourceOptions
from ispom_app.features.sweep.commands import CancelSweep, RunSweep, ShowSwept
from ispom_app.features.sweep.panel import SweepPanel, points
from ispom_app.features.sweep.sweep import Sweep
from ispom_app.features.sweep.values import Swept, Value
from ispom_app.session import commands as do
from ispom_app.session.state import State

from tests import doubles
from tests.app.helpers import with_values

NAME = "<img src=x onerror=alert(1)>"


def begun(*values: Value, setting: str = "max_tracks", method: str = "stereo") -> Sweep:
    return Sweep.begun("sweep-1", Swept(method, setting, values), NAME, SourceOptions(), 0.0)


def told(place: int, failure: str | None = None, **values: float | None) -> dict[str, Any]:
    return {"row": place, "folder": f"runs/{place}", "failure": failure, "values": values, "ms": 12.34}


def made(server: viser.ViserServer) -> tuple[SweepPanel, State, list[do.Command]]:
    commands: list[do.Command] = []
    state = State("double:20", phase="ready", run=1, methods=("stereo",))
    opened = SimpleNamespace(sequence=doubles.sequence(3))
    session: Any = SimpleNamespace(state=state, opened=opened, post=commands.append)
    panel = SweepPanel(server.gui, session)
    panel.show(state)
    return panel, state, commands


def press(button: Any) -> None:
    for callback in button._impl.update_cb:
        callback(SimpleNamespace())


def test_it_requests_what_is_chosen_and_proposes_values(server: viser.ViserServer) -> None:
    panel, _, commands = made(server)
    assert panel._method.value == "Stereo" and panel._values.value == "100, 200, 400, 800"
    panel._setting.value = "relocalise"
    assert panel._values.value == "off, on"
    panel._method.value = "Monocular"
    assert panel._setting.value == "max tracks" and panel._values.value == "120, 250, 500, 1000"
    panel._setting.value = "min parallax [°]"
    panel._values.value = "1, 2"
    press(panel._start)
    assert commands == [RunSweep("monocular", "min_parallax_deg", "1, 2")]


def test_it_shows_how_far_it_is_and_what_came(server: viser.ViserServer) -> None:
    panel, state, commands = made(server)
    sweep = begun(100, 200, 400).after({"at": [0, 10, 20]}, 10.0)
    panel.show(with_values(state, sweep=sweep))
    assert panel._cancel.visible and not panel._start.visible and panel._bar.visible
    assert "0 of 3 runs, 50 s left" in panel._text.content and "50 % of the frames" in panel._text.content
    assert NAME not in panel._text.content, "names come from files"
    press(panel._cancel)
    sweep = sweep.after(told(0, ate_m=0.0123, t_err_percent=1.5, located_percent=90.0), 20.0)
    sweep = replace(sweep.after(told(2, "no such disparity"), 30.0), ended=True, problem="cancelled")
    panel.show(with_values(state, sweep=sweep))
    text = panel._text.content
    for said in ("12.3 mm", "1.50 %", "90 %", "12.3<", "failed: no such disparity", "waits", "2 of 3 runs: cancelled"):
        assert said in text, said
    assert panel._start.visible and not panel._cancel.visible
    assert panel._choice.options == ("100",), "what failed has no run to show"
    press(panel._show)
    assert commands == [CancelSweep(), ShowSwept(0)]


@pytest.mark.parametrize(
    ("values", "x"), [((400, 100), [100, 400]), ((0.5, 1.0), [0.5, 1.0]), ((False, True), [0, 1]), (("a", "b"), [0, 1])]
)
def test_the_plot_has_the_values_in_rising_order_and_words_in_their_order(values: tuple, x: list[float]) -> None:
    sweep = begun(*values).after(told(0, ate_m=4.0), 1.0)
    assert points(sweep) is None
    found = points(sweep.after(told(1, ate_m=5.0), 1.0))
    assert found is not None and found[2] == "ate_m"
    np.testing.assert_array_equal(found[0], x)
    np.testing.assert_array_equal(found[1], [5.0, 4.0] if values[0] == 400 else [4.0, 5.0])


def test_without_truth_the_share_that_is_located_is_drawn(server: viser.ViserServer) -> None:
    panel, state, _ = made(server)
    sweep = begun("norm", "unit", setting="scale_transfer", method="monocular.paper")
    for place in (0, 1):
        sweep = sweep.after(told(place, ate_m=None, located_percent=50.0 + place), 1.0)
    found = points(sweep)
    assert found is not None and found[2] == "located_percent"
    panel.show(with_values(state, sweep=sweep))
    assert panel._plot._folder.visible and "n/a" in panel._text.content
