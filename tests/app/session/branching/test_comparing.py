"""The first differences between two branches."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from ispom_app.features.branches.commands import DeleteBranch, Fork, ShowBranch
from ispom_app.features.runs.commands import CompareRuns
from ispom_app.session import commands as do
from ispom_app.session.branches.branches import Branch
from ispom_app.session.branches.comparison import Comparison, advanced, begin, forked_at
from ispom_app.session.branches.service import BranchService
from ispom_app.session.branches.state import Branches
from ispom_app.session.session import Session

from ispom.ensemble import Ensemble
from ispom.errors import InputError
from ispom.methods import Config
from ispom.types import Measurement, Rig, Step
from tests import doubles
from tests.alone import METHODS
from tests.app.helpers import paused_session, wait_for

FORK, PLANTED = 21, 30


class Planted(doubles.FakeEstimator):
    """Says something else of one frame when its settings are others."""

    changed = False

    def step(self, state: Any, exposure: Measurement, asked: object = None) -> tuple[Any, Step]:
        after, step = super().step(state, exposure)
        late = exposure.time_ns >= doubles.sequence(40).times_ns[PLANTED]
        return after, replace(step, scale=1.5) if self.changed and late and self.method == "monocular" else step


def build(config: Config, methods: tuple[str, ...], rig: Rig) -> Ensemble:
    made = doubles.ensemble(methods, Planted)
    if config != Config():
        for member in made.members.values():
            member.estimator.changed = True  # type: ignore[attr-defined]
    return made


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    with paused_session(tmp_path, "double:40", builder=build) as found:
        found.post(do.Seek(43))
        wait_for(lambda: found.state.computed == 44, "the run")
        yield found


def forked(session: Session, config: Config) -> None:
    session.post(do.Seek(FORK - 1))
    wait_for(lambda: session.state.index == FORK - 1, "the frame to fork at")
    session.post(Fork(METHODS, config))
    session.post(do.Seek(43))
    wait_for(lambda: session.state[Branches].shown == 1 and session.state.computed == 44, "the fork")


def compared(session: Session) -> Comparison:
    session.post(CompareRuns("live:1", "live:0"))
    wait_for(
        lambda: session.state[Branches].comparison and session.state[Branches].comparison.finished, "the comparison"
    )
    assert session.state[Branches].comparison is not None
    return session.state[Branches].comparison


def test_a_fork_with_unchanged_settings_differs_in_nothing(session: Session) -> None:
    forked(session, Config())
    found = compared(session)
    assert (found.start, found.stop, found.differing_frames, found.first) == (FORK, 44, 0, ())


def other() -> Config:
    config = Config()
    monocular = config.of("monocular")
    name = next(n for n, v in vars(monocular).items() if isinstance(v, int) and not isinstance(v, bool))
    return config.with_settings("monocular", replace(monocular, **{name: getattr(monocular, name) + 1}))


def test_a_planted_difference_is_found_at_its_exposure_and_only_then(session: Session) -> None:
    forked(session, other())
    found = compared(session)
    (first,) = found.first
    assert first.exposure == PLANTED and [(d.name, d.a, d.b, d.by) for d in first.differences] == [
        ("monocular.scale", 1.5, 1.0, 0.5)
    ]
    assert found.differing_frames == sum(kind == "video" for kind in doubles.sequence(40).kinds[PLANTED:])
    session.post(ShowBranch(0))
    session.post(DeleteBranch(1))
    wait_for(lambda: session.state[Branches].comparison is None, "a deleted branch is not compared any more")


def test_a_slice_compares_one_exposure_at_least_and_no_more_than_its_time(session: Session) -> None:
    forked(session, Config())
    a, b = session.service(BranchService).run_of(1), session.service(BranchService).run_of(0)
    assert a is not None and b is not None
    now = begin(session.state[Branches].all, 1, 0, a, b)
    assert advanced(now, a, b, 0.0).done == now.start + 1


def test_of_thinned_records_the_rest_is_compared_and_they_are_counted(session: Session) -> None:
    forked(session, Config())
    a, b = session.service(BranchService).run_of(1), session.service(BranchService).run_of(0)
    assert a is not None and b is not None

    def without_points(index: int) -> Any:
        record = b.history[index]
        steps = tuple(replace(step, tracks={}, residuals_px=step.residuals_px[:0]) for step in record.steps)
        return replace(record, steps=steps, thinned=True)

    thinned: Any = SimpleNamespace(history=[without_points(i) for i in range(44)], opened=b.opened)
    now = begin(session.state[Branches].all, 1, 0, a, thinned)
    found = advanced(now, a, thinned, 60.0)
    assert (found.thinned, found.differing_frames) == (44 - FORK, 0)


def test_branches_part_where_the_earlier_of_them_was_forked() -> None:
    tree = (Branch(0, "first"), Branch(1, "b", 0, 30), Branch(2, "c", 0, 20), Branch(3, "d", 1, 40))
    wanted = {(0, 1): 30, (1, 2): 20, (0, 3): 30, (1, 3): 40, (3, 2): 20}
    for (a, b), at in wanted.items():
        assert forked_at(tree, a, b) == forked_at(tree, b, a) == at
    assert forked_at((tree[0], tree[3]), 0, 3) == 0, "what was between them is not known any more"


def test_a_branch_is_not_compared_with_itself() -> None:
    with pytest.raises(InputError, match="choose another one"):
        begin((), 1, 1, None, None)  # type: ignore[arg-type]
