"""The panel of branches, and their lines in the 3-D view."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import viser
from ispom_app.engine.model.run_model import Tally
from ispom_app.engine.playback import Playback
from ispom_app.features.branches.commands import DeleteBranch, HideBranch, RenameBranch, ShowBranch
from ispom_app.features.branches.panel import DELETE, SHOW, BranchesPanel, _entry
from ispom_app.features.branches.stage import trajectories
from ispom_app.presentation.texts import MILLIMETRE
from ispom_app.session import commands as do
from ispom_app.session.branches.accuracy import measured
from ispom_app.session.branches.branches import Branch, BranchInView
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.state import State, reduce

from ispom.evaluation.metrics import path_errors
from tests import doubles
from tests.alone import METHODS
from tests.app import helpers
from tests.app.gui import Gui, press
from tests.app.helpers import run_to_end, with_values

NAME = "<img src=x onerror=alert(1)>"


@pytest.fixture(scope="module")
def run() -> CurrentRun:
    return run_to_end(Playback(doubles.sequence(20), METHODS, builder=helpers.build))


def with_branches(run: CurrentRun, *branches: Branch) -> State:
    return with_values(reduce(State("double:20"), run.opened), branches=branches)


@pytest.fixture
def two(run: CurrentRun) -> State:
    first = Branch(0, "first run", computed=22, tally=run.tally)
    return with_branches(run, first, Branch(1, NAME, 0, 9, ("stereo.max-tracks 500 → 300",), 12, run.tally))


def made(server: viser.ViserServer, state: State) -> tuple[BranchesPanel, Gui, list[do.Command]]:
    commands: list[do.Command] = []
    run: Any = SimpleNamespace(opened=SimpleNamespace(truth=None))
    session: Any = SimpleNamespace(
        state=state, post=commands.append, service=lambda kind: SimpleNamespace(run_of=lambda number: run)
    )
    gui: Any = Gui(server)
    panel = BranchesPanel(gui, session)
    panel.show(state)
    return panel, gui, commands


def test_it_shows_how_much_of_a_run_is_in_memory_and_what_is_thinned(
    server: viser.ViserServer, run: CurrentRun
) -> None:
    usage = run.history_usage
    panel, gui, _ = made(server, with_branches(run, Branch(0, "first run", history_usage=usage)))
    assert usage.in_memory == 22 and usage.points_from == 0 and usage.interval == 8
    assert usage.sentence in gui.text
    panel.show(with_branches(run, Branch(0, "first run", history_usage=replace(usage, points_from=5))))
    assert "from frame 5" in gui.text


def test_with_one_run_it_says_how_to_fork(server: viser.ViserServer, run: CurrentRun) -> None:
    _, gui, _ = made(server, with_branches(run, Branch(0, "first run")))
    assert "press Fork" in gui.text and not gui.labelled("branch").visible


def test_it_lists_what_differs_and_how_each_method_does(server: viser.ViserServer, two: State) -> None:
    _, gui, _ = made(server, two)
    text = gui.text
    assert all(part in text for part in ("from frame 9", "stereo.max-tracks 500 → 300", "12 of 22"))
    assert text.count("Stereo") == 2 and "lost" in text and "ATE" in text
    assert "<img" not in text and "&lt;img" in text, "a name is never markup"


def test_every_error_is_the_ate_with_its_alignment_named(server: viser.ViserServer, run: CurrentRun) -> None:
    branch = Branch(0, "first run", computed=22, tally=run.tally, measured=measured(run))
    rows = _entry(branch, with_branches(run, branch), MILLIMETRE, True)["methods"]
    assert [row["ate"].split()[-1] for row in rows if row["ate"]] == ["Sim(3)", "SE(3)"]
    assert all("poses, aligned by" in row["ate_hint"] for row in rows if row["ate"])
    assert {row["ms"] for row in rows} == {"5.00"}


def test_without_ground_truth_there_is_no_error(run: CurrentRun) -> None:
    branch = Branch(0, "first run", computed=22, tally=run.tally)
    rows = _entry(branch, with_branches(run, branch), MILLIMETRE, False)["methods"]
    assert {row["ate"] for row in rows} == {"no truth"}


def test_the_error_is_that_of_the_evaluation(run: CurrentRun) -> None:
    finished, truth = run.playback.finish(), run.opened.truth
    assert truth is not None
    wanted = path_errors(finished.trajectories["monocular"], truth, run.opened.sequence.rig, metric=False)["ate_m"]
    assert measured(run).errors["monocular"].ate_m == wanted


def test_methods_are_in_the_order_of_the_registry(server: viser.ViserServer, run: CurrentRun) -> None:
    tally = Tally(dict(reversed(list(run.tally.methods.items()))))
    _, gui, _ = made(server, with_branches(run, Branch(0, "first run", tally=tally)))
    places = [gui.text.index(f"<td>{label}") for label in ("Monocular", "Stereo", "Integrated")]
    assert places == sorted(places)


def test_the_newest_branch_is_chosen_and_its_controls_act_on_it(server: viser.ViserServer, two: State) -> None:
    _, gui, commands = made(server, two)
    assert gui.labelled("branch").value == f"1: {NAME}"
    assert gui.labelled("name").value == NAME and gui.labelled("drawn").value
    (buttons,) = gui.every("button_group")
    buttons.value = SHOW
    buttons.value = DELETE
    press(gui.labelled("Rename"))
    assert commands == [ShowBranch(1), DeleteBranch(1), RenameBranch(1, NAME)]
    gui.labelled("drawn").value = False
    assert commands[-1] == HideBranch(1, True)


def test_of_the_branch_that_is_shown_the_parent_is_chosen_to_compare(server: viser.ViserServer, two: State) -> None:
    panel, gui, _ = made(server, two)
    panel.show(with_values(two, branch=1))
    assert gui.labelled("branch").value == "0: first run"
    panel.show(with_values(two, branch=1, computed=two.computed))
    gui.labelled("branch").value = f"1: {NAME}"
    panel.show(with_values(two, branch=1))
    assert gui.labelled("branch").value == f"1: {NAME}", "a person's choice stays"


def test_choosing_another_fills_its_name(server: viser.ViserServer, two: State) -> None:
    _, gui, commands = made(server, two)
    gui.labelled("branch").value = "0: first run"
    assert gui.labelled("name").value == "first run" and not commands


def test_each_method_of_a_branch_is_a_line_where_its_poses_are(run: CurrentRun) -> None:
    last = run.history.last
    assert last is not None
    model = run.known_at(21)
    branches = {1: BranchInView(model, last.placements, (1, 2, 3))}
    drawn = {entry.path: entry.value for entry in trajectories(branches, frozenset({"stereo"}))}
    assert set(drawn) == {f"world/branches/1/{m}" for m in METHODS if m != "stereo"}
    (line, *others) = drawn["world/branches/1/monocular"].strips.as_arrow_array().to_pylist()
    poses = model.methods["monocular"].poses.trajectory(model.times).translations
    assert not others and np.allclose(line, last.placements["monocular"].apply(poses), atol=1e-5)
