"""What a run has no use for is not loaded with it, and is there for who has."""

from __future__ import annotations

import subprocess
import sys

UNUSED = (
    "numpy.f2py",
    "numpy.testing",
    "scipy.optimize",
    "scipy.interpolate",
    "matplotlib",
    "open3d",
    "viser",
)
CODE = f"""
import sys
import ispom_app.cli.main, ispom_app.features.headless.command, ispom_app.views.rerun.file_recording
print(*(name for name in {UNUSED} if name in sys.modules))
import numpy as np
assert np.f2py and np.testing and "ma" in dir(np) and "ctypeslib" in np.__all__
"""


def test_a_run_loads_nothing_that_it_has_no_use_for() -> None:
    found = subprocess.run([sys.executable, "-c", CODE], check=True, capture_output=True, text=True)
    assert not found.stdout.split()
