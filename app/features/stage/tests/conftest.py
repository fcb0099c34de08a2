from __future__ import annotations

import pytest
from ispom_app.engine.playback import Playback
from ispom_app.session.current_run import CurrentRun

from tests import doubles
from tests.alone import METHODS
from tests.app.helpers import build_full, run_to_end


@pytest.fixture(scope="module")
def run() -> CurrentRun:
    """Says all that a run can say."""
    return run_to_end(Playback(doubles.sequence(40), METHODS, builder=build_full))
