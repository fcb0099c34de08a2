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
from ispom_app.features.sweep.panel import CANCEL, RUN, SHOW, SweepPanel, points
from ispom_app.features.sweep.sweep import Sweep
from ispom_app.features.sweep.values import Swept, Value
from ispom_app.session import commands as do
from ispom_app.session.state import State

from tests import doubles
from tests.app.gui import Gui, press
from tests.app.helpers import with_values

NAME = "<img src=x onerror=alert(1)>"


def begun(*values: Value, setting: str = "max_tracks", method: str = "stereo") -> Sweep:
    return Sweep.begun("sweep-1", Swept(method, setting, values), NAME, SourceOptions(), 0.0)


def told(place: int, failure: str | None = None, **values: float | None) -> dict[str, Any]:
    return {"row": place, "folder": f"runs/{place}", "failure": failure, "values": values, "ms": 12.34}


def made(server: viser.ViserServer) -> tuple[SweepPanel, Gui, State, list[do.Command]]:
    commands: list[do.Command] = []
    state = State("double:20", phase="ready", run=1, methods=("stereo",))
    opened = SimpleNamespace(sequence=doubles.sequence(3))
    session: Any = SimpleNamespace(state=state, opened=opened, post=commands.append)
    gui: Any = Gui(server)
    panel = SweepPanel(gui, session)
    panel.show(state)
    return panel, gui, state, commands


def test_it_requests_what_is_chosen_and_proposes_values(server: viser.ViserServer) -> None:
    _, gui, _, commands = made(server)
    assert gui.labelled("method").value == "Stereo" and gui.labelled("values").value == "100, 200, 400, 800"
    gui.labelled("setting").value = "relocalise"
    assert gui.labelled("values").value == "off, on"
    gui.labelled("method").value = "Monocular"
    assert gui.labelled("setting").value == "max tracks" and gui.labelled("values").value == "120, 250, 500, 1000"
    gui.labelled("setting").value = "min parallax [°]"
    gui.labelled("values").value = "1, 2"
    press(gui.labelled(RUN))
    assert commands == [RunSweep("monocular", "min_parallax_deg", "1, 2")]


def test_it_shows_how_far_it_is_and_what_came(server: viser.ViserServer) -> None:
    panel, gui, state, commands = made(server)
    sweep = begun(100, 200, 400).after({"at": [0, 10, 20]}, 10.0)
    panel.show(with_values(state, sweep=sweep))
    assert gui.labelled(CANCEL).visible and not gui.labelled(RUN).visible and gui.every("progress_bar")[0].visible
    assert "0 of 3 runs, 50 s left" in gui.text and "50 % of the frames" in gui.text
    assert NAME not in gui.text, "names come from files"
    press(gui.labelled(CANCEL))
    sweep = sweep.after(told(0, ate_m=0.0123, t_err_percent=1.5, located_percent=90.0), 20.0)
    sweep = replace(sweep.after(told(2, "no such disparity"), 30.0), ended=True, problem="cancelled")
    panel.show(with_values(state, sweep=sweep))
    text = gui.text
    for said in ("12.3 mm", "1.50 %", "90 %", "12.3<", "failed: no such disparity", "waits", "2 of 3 runs: cancelled"):
        assert said in text, said
    assert gui.labelled(RUN).visible and not gui.labelled(CANCEL).visible
    assert gui.labelled("value").options == ("100",), "what failed has no run to show"
    press(gui.labelled(SHOW))
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
    panel, gui, state, _ = made(server)
    sweep = begun("norm", "unit", setting="scale_transfer", method="monocular.paper")
    for place in (0, 1):
        sweep = sweep.after(told(place, ate_m=None, located_percent=50.0 + place), 1.0)
    found = points(sweep)
    assert found is not None and found[2] == "located_percent"
    panel.show(with_values(state, sweep=sweep))
    assert gui.labelled("Error against the value").visible and "n/a" in gui.text
