"""The position errors of branches and of other programs in one plot of the time dock."""

from __future__ import annotations

from dataclasses import replace

import pytest
from ispom_app.engine.playback import Playback
from ispom_app.features.plots.page_message import PlotNews, error_curves
from ispom_app.presentation import colours
from ispom_app.session.branches.accuracy import errors_of_external, measured
from ispom_app.session.branches.branches import Branch
from ispom_app.session.branches.state import Branches
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.external_paths import ExternalPaths
from ispom_app.session.state import State, reduce

from tests import doubles
from tests.alone import METHODS
from tests.app import helpers
from tests.app.helpers import with_values
from tests.app.run.external_trajectories.made import elsewhere, external, written

SEQUENCE = doubles.sequence(20)
OWN = ["Monocular (Sim(3))", "Integrated (SE(3))"]
"""Two stereo poses fix no alignment."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> CurrentRun:
    path = written(tmp_path_factory.mktemp("beside") / "a.tum", elsewhere(SEQUENCE, unit_m=0.9))
    others = (external(SEQUENCE, path),)
    return helpers.run_to_end(Playback(SEQUENCE, METHODS, builder=helpers.build, external_trajectories=others))


@pytest.fixture
def state(run: CurrentRun) -> State:
    count, known = len(run.history), measured(run)
    branches = Branch(0, "first run", computed=count, measured=known), Branch(1, "fewer", 0, 5, (), 16, measured=known)
    state = with_values(reduce(State("double:20"), run.opened), branches=branches, computed=count, plots=("error",))
    return with_values(state, external_errors=errors_of_external(state[ExternalPaths].all, run))


def labels(state: State) -> list[str]:
    return [curve.label for curve, _ in error_curves(state)]


def test_every_drawn_branch_and_every_other_program_has_its_curves(state: State) -> None:
    assert labels(state) == [*OWN, *(f"fewer: {label}" for label in OWN), "orb (SE(3))"]
    found = [curve for curve, _ in error_curves(state)]
    assert len({curve.id for curve in found}) == len(found)
    assert found[-1].colour == colours.css(colours.colour_of_external(0))
    assert found[len(OWN)].colour == colours.css(state[Branches].all[1].colour)


def test_the_branch_that_is_shown_comes_first_and_one_that_is_not_drawn_has_none(state: State) -> None:
    assert labels(with_values(state, branch=1))[: len(OWN) + 1] == [*OWN, f"first run: {OWN[0]}"]
    hidden = with_values(state, branches=(state[Branches].all[0], replace(state[Branches].all[1], hidden=True)))
    assert labels(hidden) == [*OWN, "orb (SE(3))"]


def test_a_page_is_sent_them_again_when_one_has_changed(state: State, run: CurrentRun) -> None:
    news = PlotNews()
    first = news.since(state, run)
    assert first is not None and [curve for curve, _, _ in first["errors"]] == [
        c["id"] for c in first["plots"][0]["curves"]
    ]
    assert news.since(state, run) is None
    again = replace(state[Branches].all[1], measured=measured(run))
    changed = news.since(with_values(state, branches=(state[Branches].all[0], again)), run)
    assert changed is not None and len(changed["errors"]) == len(first["errors"]) and "plots" not in changed


def test_a_source_without_truth_has_none(run: CurrentRun) -> None:
    bare = CurrentRun(Playback(replace(SEQUENCE, truth=None), METHODS, builder=helpers.build), 10**8)
    bare.step()
    assert not labels(with_values(reduce(State("double:20"), bare.opened), computed=1))
