"""Pages of libraries that only their loading touched are released, and are there again when they are used."""

from __future__ import annotations

import subprocess
import sys

import pytest

SCRIPT = """
import re
from pathlib import Path
import numba
from ispom_app.engine.memory import release_library_pages
def resident_mb():
    entries = re.split(r"\\n(?=[0-9a-f]+-)", Path("/proc/self/smaps").read_text())
    code = [one for one in entries if "libllvmlite" in one.partition("\\n")[0] and " r-xp " in one]
    return sum(int(re.search(r"Rss: +(\\d+)", one)[1]) for one in code) / 1024
before = resident_mb()
release_library_pages(frames=3)
assert resident_mb() == before > 5
release_library_pages(frames=4)
assert resident_mb() < 1
assert numba.njit(lambda x: x + 1)(2) == 3 and resident_mb() > 5
"""


@pytest.mark.skipif(sys.platform != "linux", reason="Linux alone")
def test_code_that_is_not_used_is_released_at_powers_of_two_and_works_on() -> None:
    subprocess.run([sys.executable, "-c", SCRIPT], check=True)
