"""Branches: forked at the frame that is shown, kept beside each other, compared, renamed, hidden and deleted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from ispom_app.features.branches.commands import DeleteBranch, Fork, HideBranch, RenameBranch, ShowBranch
from ispom_app.session import commands as do
from ispom_app.session.branches.branches import MOST, changes
from ispom_app.session.branches.service import BranchService
from ispom_app.session.branches.state import Branches
from ispom_app.session.session import Session

from ispom.methods import Config
from tests.alone import METHODS
from tests.app.helpers import started, wait_for
from tests.same import assert_same


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    """Run to its end, frame 8 shown."""
    session = started(tmp_path)
    session.post(do.Speed(None))
    wait_for(lambda: session.state.ended, "the end")
    session.post(do.Seek(8))
    wait_for(lambda: session.state.index == 8, "exposure 8")
    yield session
    assert session.close(5.0)


def fork(session: Session, *methods: str, config: Config | None = None, name: str = "") -> int:
    """Its number, once it has run to its end."""
    count = len(session.state[Branches].all)
    session.post(Fork(methods or session.state.methods, config or session.state.config, name))
    wait_for(lambda: len(session.state[Branches].all) > count and session.state.ended, "the branch's end")
    return session.state[Branches].shown


def test_a_fork_with_nothing_changed_is_the_same_run(session: Session) -> None:
    first = session.run
    assert first is not None
    number = fork(session)
    again = session.run
    assert again is not None and again is not first and number == 1
    assert len(again.history) == len(first.history) == 22
    assert_same(list(again.history), list(first.history))
    last = len(first.history) - 1
    for index in (3, 8, 9, last):
        assert_same(again.known_at(index).methods["stereo"].poses, first.known_at(index).methods["stereo"].poses)
    assert again.tally == first.tally
    assert_same(again.finish().trajectories, first.finish().trajectories)


def test_it_shows_the_same_exposure_and_plays_on_from_there(session: Session) -> None:
    session.post(Fork(session.state.methods, session.state.config))
    wait_for(lambda: session.state[Branches].shown == 1, "the branch")
    wait_for(lambda: session.state.ended, "its end")
    (start, branch) = session.state[Branches].all
    assert (start.number, start.parent, start.computed) == (0, None, 22)
    assert (branch.parent, branch.at, branch.computed, branch.changes) == (0, 9, 22, ())


def test_a_method_can_be_switched_on_and_another_off(session: Session) -> None:
    fork(session, "stereo")
    assert session.state[Branches].all[1].changes == ("monocular off", "integrated off")
    assert {s.method for record in session.history for s in record.steps} == {"stereo"}
    session.post(do.Seek(12))
    wait_for(lambda: session.state.index == 12, "exposure 12")
    fork(session, "stereo", "integrated")
    assert session.state[Branches].all[2].changes == ("integrated on",) and session.state[Branches].all[2].parent == 1
    said = [r.index for r in session.history if any(s.method == "integrated" for s in r.steps)]
    assert said and min(said) == 13


def test_what_differs_is_listed_as_flags() -> None:
    settings = replace(Config().of("stereo"), max_tracks=300, self_calibration=False)
    default = Config().of("stereo").max_tracks
    found = changes((METHODS, Config()), (METHODS, Config({"stereo": settings})))
    assert found == (f"stereo.max-tracks {default} → 300", "stereo.self-calibration on → off")


def test_switching_back_shows_the_run_as_it_was(session: Session) -> None:
    first = session.run
    fork(session, "stereo")
    session.post(do.Seek(20))
    wait_for(lambda: session.state.index == 20, "exposure 20")
    runs = session.state.run
    session.post(ShowBranch(0))
    wait_for(lambda: session.state[Branches].shown == 0, "the first run")
    assert session.run is first and session.state.index == 20 and session.state.computed == 22
    assert session.state.methods == METHODS and session.state.run == runs + 1 and session.state.ended
    session.post(do.StepBy(-1))
    wait_for(lambda: session.state.index == 19, "the frame before")


def test_a_branch_can_be_renamed_hidden_and_deleted(session: Session) -> None:
    fork(session, name="  fewer\ntracks ")
    assert session.state[Branches].all[1].name == "fewer tracks"
    session.post(RenameBranch(1, "x" * 500))
    session.post(HideBranch(0, True))
    wait_for(lambda: session.state[Branches].all[0].hidden, "hiding")
    assert session.state[Branches].all[1].name == "x" * 40
    session.post(DeleteBranch(0))
    wait_for(lambda: len(session.state[Branches].all) == 1, "deleting")
    assert session.state[Branches].all[0].number == 1 and session.service(BranchService).run_of(0) is None
    assert session.history[2].index == 2, "what it shares with the deleted one stays"


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        (DeleteBranch(0), "the branch that is shown cannot be deleted"),
        (ShowBranch(7), "there is no such branch"),
        (RenameBranch(0, " \n"), "a branch has no name"),
        (Fork((), Config()), "no method is chosen"),
    ],
)
def test_a_mistake_is_a_sentence_and_changes_nothing(session: Session, command: do.Command, sentence: str) -> None:
    before = session.state[Branches].all
    session.post(command)
    wait_for(lambda: session.state.notices, "the notice")
    assert sentence in session.state.notices[-1].text and session.state[Branches].all == before


def test_the_number_of_branches_is_bounded(session: Session) -> None:
    for _ in range(MOST - 1):
        fork(session, "stereo")
        session.post(do.Seek(18))
        wait_for(lambda: session.state.index == 18, "exposure 18")
    session.post(Fork(("stereo",), Config()))
    wait_for(lambda: session.state.notices, "the notice")
    assert f"there are {MOST} branches" in session.state.notices[-1].text and len(session.state[Branches].all) == MOST


def test_after_the_last_exposure_there_is_nothing_to_fork(session: Session) -> None:
    session.post(do.Seek(21))
    session.post(Fork(("stereo",), Config()))
    wait_for(lambda: session.state.notices, "the notice")
    assert "nothing is left to run" in session.state.notices[-1].text and len(session.state[Branches].all) == 1


def test_a_restart_begins_with_one_branch_again(session: Session) -> None:
    fork(session, "stereo")
    session.post(do.Restart(("stereo",), Config()))
    wait_for(lambda: session.state.question, "the question")
    session.post(do.Confirm(session.state.question.number, True))  # type: ignore[union-attr]
    wait_for(lambda: len(session.state[Branches].all) == 1 and session.state.ended, "the new run")
    assert session.state[Branches].shown == 0 and session.state[Branches].all[0].tally.methods.keys() == {"stereo"}


def test_a_fork_in_the_middle_of_a_run_leaves_the_rest_to_be_computed(tmp_path: Path) -> None:
    session = started(tmp_path, autoplay=False)
    wait_for(lambda: session.state.phase == "ready", "opening")
    session.post(do.Seek(12))
    wait_for(lambda: session.state.computed == 13, "exposure 12")
    session.post(do.Seek(5))
    wait_for(lambda: session.state.index == 5, "exposure 5")
    session.post(Fork(METHODS, Config()))
    session.post(do.Play(False))
    wait_for(lambda: session.state[Branches].shown == 1 and not session.state.playing, "the branch")
    session.post(ShowBranch(0))
    session.post(do.Seek(21))
    wait_for(lambda: session.state.ended, "the end of the first run")
    assert [b.number for b in session.state[Branches].all] == [0, 1]
    assert session.close(5.0)
