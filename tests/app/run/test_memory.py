"""The peak of a process's memory, and of a run in it."""

from __future__ import annotations

import subprocess
import sys

import pytest

PEAK = """
import numpy as np
from ispom_app.engine.memory import peak_mb, reset_peak
before = peak_mb()
held = np.ones(30_000_000)
print(peak_mb() - before)
del held
reset_peak()
print(peak_mb() - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the peak cannot be reset")
def test_the_peak_counts_allocated_memory_and_begins_again() -> None:
    """In a process of its own: what tests gave back before would be taken again, and the peak stay where it was."""
    done = subprocess.run([sys.executable, "-c", PEAK], capture_output=True, text=True, check=True)
    grown, left = map(float, done.stdout.split())
    assert grown >= 100 and left < 100
