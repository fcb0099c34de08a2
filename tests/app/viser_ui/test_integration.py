"""The integration step by step: the panel from the state, and the shapes and numbers of each stage."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import viser
from ispom_app.engine.playback import Playback
from ispom_app.features.integration.commands import IntegrationSteps, ShowIntegration, StepIntegration
from ispom_app.features.integration.drawing import ROOT, Dots, Line, bracket_rows, drawing, entries, positions
from ispom_app.features.integration.integration import Integration, latest_fit
from ispom_app.features.integration.panel import NEXT, PREVIOUS, IntegrationPanel, table
from ispom_app.presentation.texts import length
from ispom_app.session import commands as do
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.state import State, reduce
from ispom_app.views.web.messages import message_of

from ispom.types import Step, Trajectory
from tests import doubles
from tests.app import helpers
from tests.app.gui import Gui
from tests.app.helpers import run_to_end

METHODS = ("monocular", "integrated", "integrated.paper")


@pytest.fixture(scope="module")
def run() -> CurrentRun:
    return run_to_end(Playback(doubles.sequence(40), METHODS, builder=helpers.build))


def fit_of(run: CurrentRun, method: str) -> Step:
    found = latest_fit(run, method, 43)
    assert found is not None
    return found[1]


def names(step: Step, stage: int) -> set[str]:
    return {shape.name for shape in drawing(step, stage)}


def test_a_segment_shows_what_each_stage_adds(run: CurrentRun) -> None:
    step = fit_of(run, "integrated.paper")
    always = {"stereo", "stereo_poses", "stereo_axes", "video", "video_poses", "video_axes"}
    assert names(step, 0) == always | {"gap"}
    assert names(step, 1) == always | {"gap", "ends", "bracket"}
    assert names(step, 2) == always | {"gap", "ends"}
    rows = bracket_rows(step.segments[0])
    times, span = step.segments[0].video.times_ns[rows], step.segments[0].span_ns
    assert len(rows) == 4 and times[0] < span[0] <= times[1] and times[2] < span[1] <= times[3]
    last = next(shape for shape in drawing(step, 4) if shape.name == "video" and isinstance(shape, Line))
    first = next(shape for shape in drawing(step, 4) if shape.name == "stereo" and isinstance(shape, Line))
    assert last.colour != first.colour and np.isfinite(last.xyz).all()


def test_a_spline_shows_exposures_then_itself_then_the_adjusted_one(run: CurrentRun) -> None:
    step = fit_of(run, "integrated")
    assert step.spline is not None
    assert [names(step, i) for i in range(3)] == [
        {"video_exposures", "pairs"},
        {"video_exposures", "pairs", "spline", "knots"},
        {"video_exposures", "pairs", "spline", "knots", "begun"},
    ]
    places = [next(s for s in drawing(step, i) if s.name == "pairs") for i in (1, 2)]
    assert all(isinstance(place, Dots) for place in places)
    moved = places[1].xyz - places[0].xyz  # type: ignore[union-attr]
    assert np.allclose(moved, [0, -0.05, 0])


def test_the_numbers_of_a_segment_shrink_from_row_to_row(run: CurrentRun) -> None:
    found = table(fit_of(run, "integrated.paper"), 3)
    assert found["title"] == "4 of 5: Rotated" and [row[1] for row in found["rows"]] == [False] * 3 + [True, False]
    assert ("scale", "0.5 m per unit") in found["facts"]
    assert found["rows"][4][2][2] == "0°"


def test_the_numbers_of_a_spline_are_shown_with_those_before(run: CurrentRun) -> None:
    found = table(fit_of(run, "integrated"), 2)
    assert found["title"] == "3 of 3: Optimised spline"
    rows = {name: values for name, _, values in found["rows"]}
    assert rows["cost"] == ("90", "30") and float(rows["video frames"][0]) == pytest.approx(
        3 * float(rows["video frames"][1]), abs=0.02
    )


def test_what_the_history_gave_up_is_neither_drawn_nor_counted(run: CurrentRun) -> None:
    step = fit_of(run, "integrated.paper")
    bare = replace(step, segments=(replace(step.segments[0], video=Trajectory.empty("video")),))
    assert drawing(bare, 0) == () and table(bare, 0) == {} and not len(positions(()))


class Panel:
    def __init__(self, server: viser.ViserServer, run: CurrentRun) -> None:
        self.asked: list[do.Command] = []
        session: Any = SimpleNamespace(state=State("double:40"), post=self.asked.append, run=run)
        self.gui: Any = Gui(server)
        self.panel = IntegrationPanel(self.gui, session)
        self.state = replace(reduce(State("double:40"), run.opened), displayed=run.history[43])


def test_the_panel_offers_what_integrates_and_requests_steps(server: viser.ViserServer, run: CurrentRun) -> None:
    made = Panel(server, run)
    panel, gui = made.panel, made.gui
    method, (buttons,) = gui.labelled("integration"), gui.every("button_group")
    panel.show(made.state)
    assert method.options == ("off", "Integrated", "Integrated, 2013") and not buttons.visible
    method.value = "Integrated, 2013"
    assert made.asked == [ShowIntegration("integrated.paper")]
    panel.show(made.state.having(IntegrationSteps(Integration("integrated.paper", 2))))
    assert "3 of 5: Scaled" in gui.text and "fitted at frame" in gui.text
    buttons.value = NEXT
    buttons.value = PREVIOUS
    assert made.asked[1:] == [StepIntegration(1), StepIntegration(-1)]
    method.value = "off"
    assert made.asked[-1] == ShowIntegration("")


def test_before_the_first_fit_the_panel_says_so(server: viser.ViserServer, run: CurrentRun) -> None:
    made = Panel(server, run)
    made.panel.show(replace(made.state, displayed=run.history[2]).having(IntegrationSteps(Integration("integrated"))))
    assert "Nothing is fitted" in made.gui.text


@pytest.mark.parametrize("stage", [0, 1, 2])
def test_the_3d_view_has_all_that_a_stage_consists_of(run: CurrentRun, stage: int) -> None:
    step = fit_of(run, "integrated.paper")
    assert {entry.path for entry in entries(step, stage)} == {f"{ROOT}/{name}" for name in names(step, stage)}


def test_rounding_is_no_length() -> None:
    assert [length(metres) for metres in (4.5e-16, 0.0, 6.13e-4, -0.5)] == ["0 mm", "0 mm", "0.61 mm", "-500 mm"]


def test_key_frames_and_cameras_do_not_hide_the_fit_that_is_looked_at(run: CurrentRun) -> None:
    state = reduce(State("double:40"), run.opened)
    before = " ".join(message_of(state)["hidden"])
    during = " ".join(message_of(state.having(IntegrationSteps(Integration("integrated"))))["hidden"])
    for part in ("key_frames", "camera"):
        assert f"world/monocular/{part}/" not in before and f"world/monocular/{part}/" in during
    assert "world/monocular/path" not in during
