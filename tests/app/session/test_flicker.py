"""A/B flicker: between which sides, and which of them is drawn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from ispom_app.features.branches.branches import Branch
from ispom_app.features.branches.commands import DeleteBranch, Fork
from ispom_app.features.branches.state import Branches
from ispom_app.features.flicker.commands import Flick, FlickerBetween
from ispom_app.features.flicker.flicker import Flicker, Side, between, sides, usual
from ispom_app.features.flicker.state import Flickering
from ispom_app.session import commands as do

from ispom.errors import InputError
from ispom.methods import Config
from tests.app.helpers import started, wait_for

A, B = Side(0, "monocular"), Side(0, "stereo")


def test_the_other_side_is_drawn_and_then_the_first_again() -> None:
    flicker = Flicker(A, B)
    assert flicker.shown == A and flicker.turned.shown == B and flicker.turned.turned == flicker


def test_the_usual_sides_are_two_branches_or_else_two_methods() -> None:
    methods = {0: ("monocular", "stereo"), 1: ("stereo",), 2: ("stereo",)}
    branches = [Branch(number, str(number)) for number in methods]
    assert usual(sides(branches, methods.__getitem__), 0) == Flicker(B, Side(2, "stereo"))
    assert usual(sides(branches[:1], methods.__getitem__), 0) == Flicker(A, B)
    with pytest.raises(InputError, match="nothing to flicker between"):
        usual((A,), 0)


def test_two_different_sides_that_are_there_are_needed() -> None:
    with pytest.raises(InputError, match="both sides are the same"):
        between((A, B), A, A)
    with pytest.raises(InputError, match="branch 3 has no stereo"):
        between((A, B), A, Side(3, "stereo"))


def test_the_key_begins_turns_and_a_deleted_branch_ends_it(tmp_path: Path) -> None:
    session = started(tmp_path)
    wait_for(lambda: session.state.ended, "the end")
    session.post(Flick())
    wait_for(lambda: session.state[Flickering].between == Flicker(A, B), "the usual sides")
    session.post(Flick())
    wait_for(lambda: session.state[Flickering].between == Flicker(A, B, on_b=True), "the other side")
    session.post(do.Seek(8))
    session.post(Fork(("monocular", "stereo"), Config()))
    wait_for(lambda: session.state[Branches].shown == 1 and session.state.ended, "the branch")
    session.post(FlickerBetween(B, replace(B, branch=1)))
    wait_for(lambda: session.state[Flickering].between == Flicker(B, Side(1, "stereo")), "two branches")
    session.post(DeleteBranch(0))
    wait_for(lambda: session.state[Flickering].between is None, "the end of the flicker")
    session.post(FlickerBetween(B, A))
    wait_for(lambda: session.state.notices, "the mistake")
    assert session.state[Flickering].between is None and "branch 0 has no stereo" in session.state.notices[-1].text
    assert session.close(5)
