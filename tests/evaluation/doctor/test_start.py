"""The doctor's first scene depends on what it is given, not on what memory held before."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

PROGRAM = """
from ispom.evaluation.doctor.examination import examination
from ispom.sequences import open_sequence

found = examination(open_sequence("sim:tiny?fault=darkness"), 0, 49).start
print(None if found is None else [found.scene.positions.tolist(), found.scene.points.tolist()])
"""
DIAGNOSIS = """
from ispom.evaluation.doctor import finding
finding.DIGITS = 17

from ispom.evaluation.doctor.diagnose import diagnose
from ispom.evaluation.doctor.examination import examination
from ispom.sequences import open_sequence

found = diagnose(examination(open_sequence("sim:tiny?fault=wrong-mount:yaw_deg=1"), 0, 49))
print([[each.suspect.key, repr(each.finding.strength), dict(each.finding.values)] for each in found.ranked])
"""


def answer(filling: str, program: str = PROGRAM) -> str:
    """Returns what the program prints where glibc fills new memory with a byte."""
    environment = {**os.environ, "MALLOC_PERTURB_": filling}
    return subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, check=True, text=True
    ).stdout


def test_memory_that_held_something_else_changes_nothing() -> None:
    clean = answer("0")
    assert clean != "None\n"
    assert answer("1") == clean


@pytest.mark.slow
def test_the_diagnosis_is_the_same_in_all_digits() -> None:
    clean = answer("0", DIAGNOSIS)
    assert "mount-turned" in clean
    assert answer("1", DIAGNOSIS) == clean
