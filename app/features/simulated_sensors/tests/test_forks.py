"""Other errors of simulated sensors: the form, the branch, and what is refused."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ispom_app.features.simulated_sensors.commands import RunWithSensors, simulated_sensors
from ispom_app.session.branches.state import Branches
from ispom_app.session.session import Session

from ispom.simulation.scenario.scenario import scenario_of_words, with_sensors
from tests.app.helpers import open_source, started, wait_for

SOURCE = "sim:tiny?duration_s=0.5&motion=drive&sensor=gnss:rate_hz=10&sensor=wheel"


def test_an_address_takes_other_sensors():
    words = SOURCE.removeprefix("sim:")
    before = scenario_of_words(words)
    gnss, wheel = before.sensors
    sensors = (replace(gnss, outage_until_s=0.3), replace(wheel, slip=0.5, pair=False))
    after = scenario_of_words(with_sensors(words, sensors))
    assert after == replace(before, sensors=sensors)
    assert scenario_of_words(with_sensors(words, before.sensors)) == before
    assert scenario_of_words(with_sensors(words, ())) == replace(before, sensors=())


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    found = started(tmp_path, SOURCE, autoplay=False, opener=open_source)
    wait_for(lambda: found.opened, "the source")
    yield found
    found.close(5)


def test_an_outage_makes_a_branch_without_the_fixes(session: Session):
    gnss, wheel = simulated_sensors(session.state.source)
    session.post(RunWithSensors((replace(gnss, outage_until_s=0.3), wheel)))
    wait_for(lambda: len(session.state[Branches].all) == 2, "the branch")
    branch = session.state[Branches].all[-1]
    assert branch.changes == ("gnss.outage-until-s 0.0 → 0.3",)
    assert session.opened is not None
    sequence = session.opened.sequence
    at = np.array([kind == "gnss" for kind in sequence.kinds])
    fixes_s = (sequence.times_ns[at] - sequence.times_ns[0]) * 1e-9
    assert len(fixes_s) and fixes_s.min() >= 0.3


def test_without_a_change_or_a_sensor_it_is_refused(session: Session):
    count = session.state.notice_count
    session.post(RunWithSensors(simulated_sensors(session.state.source)))
    wait_for(lambda: session.state.notice_count > count, "a notice")
    assert len(session.state[Branches].all) <= 1
    assert simulated_sensors("sim:tiny") == simulated_sensors("/a/folder") == simulated_sensors("sim:none?x") == ()
