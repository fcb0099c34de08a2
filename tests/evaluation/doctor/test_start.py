"""The doctor's first scene depends on what it is given, not on what memory held before."""

from __future__ import annotations

import os
import subprocess
import sys

PROGRAM = """
from ispom.evaluation.doctor.examination import examination
from ispom.evaluation.doctor.start import start
from ispom.sequences import open_sequence

found = start(examination(open_sequence("sim:tiny?fault=darkness"), 0, 49))
print(None if found is None else [found.scene.positions.tolist(), found.scene.points.tolist()])
"""


def answer(filling: str) -> str:
    """Returns what the program prints where glibc fills new memory with a byte."""
    environment = {**os.environ, "MALLOC_PERTURB_": filling}
    return subprocess.run(
        [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, check=True, text=True
    ).stdout


def test_memory_that_held_something_else_changes_nothing() -> None:
    clean = answer("0")
    assert clean != "None\n"
    assert answer("1") == clean
