from __future__ import annotations

import pytest
from ispom_app.engine.playback import Playback
from ispom_app.session.current_run import CurrentRun

from tests import doubles
from tests.alone import METHODS


@pytest.fixture(scope="module")
def run() -> CurrentRun:
    """Says all that a run can say."""
    playback = Playback(
        doubles.sequence(40),
        METHODS,
        builder=lambda config, methods, rig: doubles.ensemble(methods, doubles.FullEstimator),
    )
    found = CurrentRun(playback, 10**9)
    while not playback.done:
        found.step()
    return found
