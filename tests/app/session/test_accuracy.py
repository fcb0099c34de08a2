"""The errors that the page shows are those of `ispom run` and `ispom evaluate`."""

from __future__ import annotations

import json
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from ispom_app.engine.options import SourceOptions
from ispom_app.features.branches.panel import BranchesPanel
from ispom_app.features.plots.page_message import error_curves
from ispom_app.presentation.texts import length, lengths
from ispom_app.session import commands as do
from ispom_app.session.branches.accuracy import measured, over_common_frames
from ispom_app.session.branches.branches import Branch
from ispom_app.session.branches.state import Branches
from ispom_app.session.session import Session
from ispom_app.session.setup import SessionSetup
from ispom_app.session.state import State
from ispom_app.views.web.messages import message_of

from ispom.sequences import open_sequence
from ispom.types import Sequence
from tests.app import helpers
from tests.app.gui import text_of
from tests.app.helpers import ran, with_values
from tests.app.viser_ui.conftest import server  # noqa: F401  (a fixture)

METHODS = ("monocular", "stereo", "integrated")


def opener(source: str, _: SourceOptions | None = None) -> Sequence:
    return open_sequence(source)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    """sim:tiny in a session, run to its end."""
    session = Session(SessionSetup(opener, "sim:tiny", tmp_path_factory.mktemp("recordings"), methods=METHODS))
    session.start()
    session.post(do.Speed(None))
    helpers.wait_for(lambda: session.state.ended and shown(session.state).measured.errors, "the end", 300)
    yield session
    session.close(5.0)


@pytest.fixture(scope="module")
def metrics(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What `ispom run` says of it."""
    out = tmp_path_factory.mktemp("run") / "out"
    ran("sim:tiny", out, "--no-recording")
    return json.loads((out / "metrics.json").read_text(encoding="utf-8"))["methods"]


def shown(state: State) -> Branch:
    return next(b for b in state[Branches].all if b.number == state[Branches].shown)


def test_the_table_of_branches_agrees_with_metrics_json(tiny: Session, metrics: dict[str, Any], server) -> None:  # noqa: F811
    errors = shown(tiny.state).measured.errors
    assert set(errors) == set(METHODS) == set(metrics)
    for method, error in errors.items():
        assert error.ate_m == pytest.approx(metrics[method]["ate_m"], rel=1e-9)
        assert (error.alignment, len(error.estimate)) == (metrics[method]["aligned"], metrics[method]["poses"])
    text = text_of(BranchesPanel, server, tiny)
    printed = lengths([metrics[method]["ate_m"] for method in METHODS])
    for cell, alignment in zip(printed, ("Sim(3)", "SE(3)", "SE(3)"), strict=True):
        assert f"{cell} {alignment}" in text
    assert "RMSE" not in text and "median ms" in text


def test_the_chips_say_the_same_and_name_the_alignment(tiny: Session) -> None:
    chips = {chip["label"]: chip for chip in message_of(tiny.state)["methods"]}
    for method, label in zip(METHODS, ("Monocular", "Stereo", "Integrated"), strict=True):
        error = shown(tiny.state).measured.errors[method]
        assert chips[label]["error"] == length(error.ate_m)
        assert ("Sim(3)" if method == "monocular" else "SE(3)") in chips[label]["hint"]


def test_the_error_curve_is_that_of_the_ate(tiny: Session) -> None:
    curves = list(error_curves(tiny.state))
    assert [curve.label for curve, _ in curves] == ["Monocular (Sim(3))", "Stereo (SE(3))", "Integrated (SE(3))"]
    for (_, drawn), error in zip(curves, shown(tiny.state).measured.errors.values(), strict=True):
        assert np.sqrt(np.mean(drawn.metres**2)) == pytest.approx(error.ate_m, rel=1e-9)


def test_the_live_error_of_provisional_poses_is_unknown(tiny: Session) -> None:
    assert tiny.run is not None
    live = tiny.run.series.values("integrated.error_m", 0, len(tiny.run.history))
    assert np.isnan(live[:12]).all() and np.nanmax(live) < 0.01


def test_times_are_medians_as_in_metrics_json(tiny: Session) -> None:
    run = tiny.run
    assert run is not None
    for method, seconds in shown(tiny.state).measured.seconds.items():
        steps = [s for record in run.history for s in record.steps if s.method == method]
        assert seconds == pytest.approx(np.median([sum(s.seconds.values()) for s in steps]))


def test_before_the_first_fit_the_table_and_the_chip_say_provisional(tiny: Session, server) -> None:  # noqa: F811
    run = tiny.run
    assert run is not None
    early = run.forked(8, METHODS, run.playback.config)
    while early.catching_up:
        early.catch_up()
    branch = Branch(0, "first run", computed=8, tally=early.tally, measured=measured(early))
    state = with_values(tiny.state, branches=(branch,), branch=0, computed=8, displayed=run.history[7])
    chip = next(c for c in message_of(state)["methods"] if c["label"] == "Integrated")
    assert chip["error"] == "provisional" and "provisional" in chip["hint"]
    session: Any = type(
        "S",
        (),
        {"state": state, "service": lambda self, kind: SimpleNamespace(run_of=lambda number: early), "post": None},
    )()
    assert "provisional" in text_of(BranchesPanel, server, session)


def test_branches_are_compared_over_their_common_frames(tiny: Session) -> None:
    run = tiny.run
    assert run is not None
    short = run.forked(60, METHODS, run.playback.config)
    while short.catching_up:
        short.catch_up()
    whole, part = Branch(0, "whole", measured=measured(run)), Branch(1, "part", measured=measured(short))
    found = over_common_frames((whole, part))
    for method in METHODS:
        one, other = found[0, method], found[1, method]
        assert np.array_equal(one.estimate.times_ns, other.estimate.times_ns)
        assert len(one.estimate) < len(whole.measured.errors[method].estimate)
    assert not over_common_frames((whole,))
