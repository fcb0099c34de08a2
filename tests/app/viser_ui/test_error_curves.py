"""Error curves of branches and of other programs on one axis: which, how many points, and how often they are drawn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import viser
from ispom_app.engine.playback import Playback
from ispom_app.features.branches import error_curves as panels
from ispom_app.features.branches.accuracy import errors_beside, measured
from ispom_app.features.branches.branches import Branch
from ispom_app.features.branches.error_curves import ErrorCurvesPanel, aligned_curves, live_curves, thinned
from ispom_app.features.branches.panel import BranchesPanel
from ispom_app.features.branches.state import Branches
from ispom_app.features.external_paths.state import ExternalPaths
from ispom_app.presentation import colours
from ispom_app.presentation.texts import METRE, MILLIMETRE, length
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.state import State, reduce

from tests import doubles
from tests.alone import METHODS
from tests.app import helpers
from tests.app.helpers import with_values
from tests.app.run.beside.made import beside, elsewhere, written

SEQUENCE = doubles.sequence(20)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> CurrentRun:
    path = written(tmp_path_factory.mktemp("beside") / "a.tum", elsewhere(SEQUENCE, unit_m=0.9))
    found = CurrentRun(Playback(SEQUENCE, METHODS, builder=helpers.build, beside=(beside(SEQUENCE, path),)), 10**8)
    while not found.playback.done:
        found.step()
    return found


@pytest.fixture
def state(run: CurrentRun) -> State:
    count = len(run.history)
    known = measured(run)
    branches = Branch(0, "first run", computed=count, measured=known), Branch(1, "fewer", 0, 5, (), 16, measured=known)
    state = with_values(reduce(State("double:20"), run.opened), branches=branches, computed=count)
    return with_values(state, external_errors=errors_beside(state[ExternalPaths].all, run))


def labels(state: State, run: CurrentRun) -> list[str]:
    return [curve.label for curve in aligned_curves(state, lambda _: run)]


def test_every_drawn_branch_and_every_other_program_has_its_curves(state: State, run: CurrentRun) -> None:
    own = ["Monocular, Sim(3)", "Integrated, SE(3)"]  # two stereo poses fix no alignment
    assert labels(state, run) == [*own, *(f"fewer: {label}" for label in own), "orb, SE(3)"]
    hidden = with_values(state, branches=(state[Branches].all[0], replace(state[Branches].all[1], hidden=True)))
    assert labels(hidden, run) == [*own, "orb, SE(3)"]
    live = [curve.label for curve in live_curves(hidden, lambda _: run)]
    assert live == [f"{colours.label(m)}, live" for m in METHODS], "another program has no live poses"
    curves = list(aligned_curves(state, lambda _: run))
    assert len(curves[0].values) == 22 and len(curves[len(own)].values) == 16, "each as far as it is computed"
    assert curves[-1].colour == colours.beside(0) and curves[len(own)].colour == state[Branches].all[1].colour


def test_a_source_without_truth_has_none(run: CurrentRun) -> None:
    bare = CurrentRun(Playback(replace(SEQUENCE, truth=None), METHODS, builder=helpers.build), 10**8)
    bare.step()
    state = with_values(reduce(State("double:20"), bare.opened), computed=1)
    assert not list(aligned_curves(state, lambda _: bare)) and not list(live_curves(state, lambda _: bare))


def test_a_point_is_the_largest_error_of_its_exposures() -> None:
    values = np.array([1.0, 5.0, np.nan, 2.0, np.nan, np.nan, 7.0])
    assert np.array_equal(thinned(values, 9, 2), [5.0, 2.0, np.nan, 7.0, np.nan], equal_nan=True)


class Drawn:
    """A panel on a clock, and how often its picture was sent."""

    def __init__(self, server: viser.ViserServer, run: CurrentRun, monkeypatch: pytest.MonkeyPatch) -> None:
        self.clock = SimpleNamespace(now=100.0)
        monkeypatch.setattr(panels, "time", SimpleNamespace(monotonic=lambda: self.clock.now))
        session: Any = SimpleNamespace(service=lambda kind: SimpleNamespace(run_of=lambda _: run))
        self.panel = ErrorCurvesPanel(server.gui, session)

    @property
    def points(self) -> int:
        plot = self.panel._plots[1].plot
        assert plot is not None
        return len(plot.data[0])


def test_while_exposures_are_computed_it_is_drawn_once_a_second(server, state, run, monkeypatch) -> None:
    drawn = Drawn(server, run, monkeypatch)
    seen = []
    for computed, at_s in ((4, 100.0), (8, 100.5), (12, 101.0), (16, 101.5)):
        drawn.clock.now = at_s
        branch = with_values(state[Branches].all[0], computed=computed)
        drawn.panel.show(with_values(state, computed=computed, playing=True, branches=(branch,)))
        seen.append(drawn.points)
    assert seen == [4, 4, 12, 12]
    branch = with_values(state[Branches].all[0], computed=22)
    drawn.panel.show(with_values(state, ended=True, branches=(branch,)))
    assert drawn.points == 22, "the end is drawn at once"
    plot = drawn.panel._plots[1].plot
    assert plot is not None and plot.scales is not None and plot.scales["x"]["range"] == (0.0, 21.0), "all frames"


def test_a_long_run_has_no_more_points_than_the_plot_has_room_for(server, state, run, monkeypatch) -> None:
    monkeypatch.setattr(panels, "MOST_POINTS", 10)
    drawn = Drawn(server, run, monkeypatch)
    drawn.panel.show(state)
    assert drawn.points == 8


def test_the_table_has_a_row_for_each_other_program(server: viser.ViserServer, state: State) -> None:
    session: Any = SimpleNamespace(state=state, post=print, service=lambda kind: SimpleNamespace(run_of=lambda _: None))
    text = BranchesPanel(server.gui, session)._text.content
    assert "Other programs" in text and "orb: a.tum, aligned to the ground truth by se3" in text
    (other,) = state[ExternalPaths].all
    truth = state[ExternalPaths].errors["orb"]
    assert f"{length(truth.ate_m, METRE)} SE(3)" in text or f"{length(truth.ate_m, MILLIMETRE)} SE(3)" in text
    assert Path(other.given.file.path).name in text
