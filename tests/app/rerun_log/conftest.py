"""A run of stand-ins that is yet to be stepped."""

from __future__ import annotations

import pytest
from ispom_app.engine.playback import Playback

from tests import doubles
from tests.alone import METHODS
from tests.app import helpers


@pytest.fixture
def run() -> Playback:
    return Playback(doubles.sequence(), METHODS, builder=helpers.build)
