"""Some of the signals that `python -m tests.signals` sends, at moments of the commands that take least."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="processes are found by /proc"),
    pytest.mark.timeout(1800),
]


@pytest.mark.parametrize("count", [2, pytest.param(60, marks=pytest.mark.slow)])
def test_a_signal_at_any_moment_ends_a_command_in_good_order(count: int, tmp_path: Path) -> None:
    from tests.signals.inputs import made_inputs
    from tests.signals.run import cases, duration_s, fault

    names = ("run", "fork", "repair")
    (tmp_path / "inputs").mkdir()
    inputs = made_inputs(tmp_path / "inputs", methods=("stereo.paper",))
    chosen, takes_s = cases(count, 0, names), dict[str, float]()
    for name in {case.name for case in chosen}:
        (tmp_path / name).mkdir()
        takes_s[name] = duration_s(name, inputs, tmp_path / name)
    faults = [f"{case}: {wrong}" for case in chosen if (wrong := fault(case, inputs, takes_s[case.name]))]
    assert not faults, "\n".join(faults)
