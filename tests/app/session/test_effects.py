"""Errors of the calibration: what is predicted of the run that is shown, and the branch that runs with them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from ispom_app.features.sensitivity.commands import Predict, RunPerturbed
from ispom_app.features.sensitivity.service import CalibrationEffect
from ispom_app.session import commands as do
from ispom_app.session.branches.state import Branches
from ispom_app.session.session import Session

from ispom.ensemble import build
from ispom.evaluation.sensitivity.perturbation import Perturbation
from ispom.sequences import open_sequence
from tests.app.helpers import started, wait_for

WRONG = Perturbation(baseline_percent=2)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    found = started(
        tmp_path_factory.mktemp("effects"), "sim:tiny", opener=lambda source, _=None: open_sequence(source),
        builder=build, methods=("stereo",), autoplay=False,
    )  # fmt: skip
    wait_for(lambda: found.state.phase == "ready", "opening")
    yield found
    found.close(5.0)


def test_before_anything_is_seen_nothing_is_predicted(session: Session) -> None:
    session.post(Predict(WRONG))
    wait_for(lambda: session.state.notices, "the refusal")
    assert "go on" in session.state.notices[-1].text
    session.post(RunPerturbed())
    wait_for(lambda: "move a slider" in session.state.notices[-1].text, "the refusal of a rerun")


def test_the_rerun_is_a_branch_that_is_drawn_with_its_prediction(session: Session) -> None:
    session.post(do.Seek(session.state.total - 1))
    wait_for(lambda: session.state.ended, "the end", 120.0)
    session.post(Predict(WRONG))
    wait_for(lambda: session.state[CalibrationEffect].effect is not None, "the prediction", 60.0)
    effect = session.state[CalibrationEffect].effect
    assert effect is not None and effect.computed == session.state.total
    (prediction,) = effect.predictions
    assert prediction.linear and prediction.ate_m is not None and prediction.predicted_ate_m is not None
    session.post(RunPerturbed())
    wait_for(lambda: session.state[Branches].shown == 1, "the branch")
    opened = session.opened
    assert opened is not None
    assert opened.sequence.rig.baseline_m == pytest.approx(1.02 * 0.4)
    assert [external.name for external in opened.external_trajectories] == ["predicted-stereo"]
    session.post(do.Seek(session.state.total - 1))
    wait_for(
        lambda: (
            session.state[CalibrationEffect].effect is not None and session.state[CalibrationEffect].effect.outcomes
        ),
        "the outcome",
        120.0,
    )
    assert session.state[CalibrationEffect].effect is not None
    (outcome,) = session.state[CalibrationEffect].effect.outcomes
    assert outcome.agrees and outcome.ratio == pytest.approx(1, abs=0.3)
    external = opened.external_trajectories[0].of_truth
    assert external is not None and np.isfinite(external.errors_m).any()


def test_while_the_rerun_is_shown_predictions_are_of_the_run_before_it(session: Session) -> None:
    assert session.state[Branches].shown == 1
    session.post(Predict(Perturbation(baseline_percent=-2)))
    wait_for(
        lambda: (
            session.state[CalibrationEffect].effect
            and session.state[CalibrationEffect].effect.wrong.baseline_percent == -2
        ),
        "the prediction",
    )
    assert session.state[CalibrationEffect].effect is not None and not session.state[CalibrationEffect].effect.rerun
    (prediction,) = session.state[CalibrationEffect].effect.predictions
    assert prediction.shift_m > 0


def test_another_run_has_no_prediction_yet(session: Session) -> None:
    session.post(do.Restart(("stereo",), session.state.config))
    wait_for(lambda: session.state.question, "the question")
    session.post(do.Confirm(session.state.question.number, True))  # type: ignore[union-attr]
    wait_for(
        lambda: len(session.state[Branches].all) == 1 and session.state[CalibrationEffect].effect is None, "the new run"
    )


def test_a_value_out_of_its_range_is_refused(session: Session, tmp_path: Path) -> None:
    before = session.state.notice_count
    session.post(Predict(Perturbation(baseline_percent=80)))
    wait_for(lambda: session.state.notice_count > before, "the refusal")
    assert "baseline" in session.state.notices[-1].text
