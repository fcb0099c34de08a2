"""A run does not load large packages that it does not use."""

from __future__ import annotations

import subprocess
import sys

UNUSED = (
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
"""


def test_a_run_loads_only_what_it_uses() -> None:
    found = subprocess.run([sys.executable, "-c", CODE], check=True, capture_output=True, text=True)
    assert not found.stdout.split()
