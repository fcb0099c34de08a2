"""The integration step by step: which fit is looked at, and its stages."""

from __future__ import annotations

from pathlib import Path

import pytest
from ispom_app.engine.playback import Playback
from ispom_app.features.integration.commands import IntegrationSteps, ShowIntegration, StepIntegration
from ispom_app.features.integration.integration import Integration, latest_fit, stage_count
from ispom_app.session.current_run import CurrentRun

from tests import doubles
from tests.app import helpers
from tests.app.helpers import run_to_end, started, wait_for

METHODS = ("monocular", "integrated", "integrated.paper")


@pytest.fixture(scope="module")
def run() -> CurrentRun:
    return run_to_end(Playback(doubles.sequence(40), METHODS, builder=helpers.build))


def test_the_latest_fit_up_to_an_exposure_is_found(run: CurrentRun) -> None:
    assert latest_fit(run, "integrated.paper", 9) is None and latest_fit(run, "monocular", 40) is None
    assert latest_fit(run, "nobody", 40) is None
    fits = {i: found and found[0] for i in range(44) if (found := latest_fit(run, "integrated.paper", i)) or i < 10}
    assert all(at is None or at <= i for i, at in fits.items()) and len(set(fits.values())) > 5
    found = latest_fit(run, "integrated", 43)
    assert found is not None and found[1].spline is not None and stage_count(found[1]) == 3
    found = latest_fit(run, "integrated.paper", 43)
    assert found is not None and stage_count(found[1]) == 5


def test_its_stages_are_stepped_through_and_end_at_both_ends(tmp_path: Path) -> None:
    session = started(tmp_path, "double:40", methods=METHODS)
    wait_for(lambda: session.state.ended, "the end")
    session.post(StepIntegration(1))
    wait_for(lambda: session.state.notices, "the mistake")
    assert "no integration" in session.state.notices[-1].text
    session.post(ShowIntegration("integrated.paper"))
    wait_for(lambda: session.state[IntegrationSteps].shown == Integration("integrated.paper", 0), "the first stage")
    for stage in (1, 2, 3, 4):
        session.post(StepIntegration(1))
        wait_for(
            lambda stage=stage: session.state[IntegrationSteps].shown == Integration("integrated.paper", stage),
            "a stage",
        )
    session.post(StepIntegration(1))
    session.post(StepIntegration(-1))
    wait_for(
        lambda: session.state[IntegrationSteps].shown == Integration("integrated.paper", 3), "one back from the last"
    )
    session.post(ShowIntegration("monocular"))
    wait_for(lambda: len(session.state.notices) > 1, "the mistake")
    assert "nothing up to frame 43" in session.state.notices[-1].text
    session.post(ShowIntegration(""))
    wait_for(lambda: session.state[IntegrationSteps].shown is None, "the end of looking")
    assert session.close(5)
