"""A run does not load what it does not use: large packages, and other methods."""

from __future__ import annotations

import subprocess
import sys

UNUSED = (
    "scipy.optimize",
    "scipy.interpolate",
    "matplotlib",
    "open3d",
    "viser",
    "scipy.sparse.linalg",
    "rich",
    "ispom.evaluation.doctor",
    "ispom.calibration.tracked",
    "ispom.calibration.adjust",
)
"""What a run does not use that has no terminal, no loop, a calibration, and few frames."""
OTHERS = ("ispom.estimators.modern.integrated", "ispom.estimators.paper", "ispom.estimators.survey.")
"""Beginnings of the names of modules that a run of `stereo` does not use."""


def loaded(code: str) -> list[str]:
    """Returns the modules that are loaded in a new process after the code."""
    lines = f"import sys\n{code}\nprint(*sys.modules)"
    return subprocess.run([sys.executable, "-c", lines], check=True, capture_output=True, text=True).stdout.split()


def test_a_run_loads_only_what_it_uses() -> None:
    modules = loaded(
        "import ispom_app.cli.main, ispom_app.features.headless.command, ispom_app.views.rerun.file_recording"
    )
    assert not set(UNUSED) & set(modules)


def test_a_run_loads_no_other_methods() -> None:
    modules = loaded(
        "from ispom_app.cli.main import COMMANDS\n"
        "words = ['a/folder', '--methods', 'stereo', '--stereo.max-tracks', '300']\n"
        "options = COMMANDS.get('run').read(words)\n"
        "import ispom_app.features.headless.command\n"
        "assert options.config.of('stereo').max_tracks == 300"
    )
    assert "ispom.estimators.modern.stereo.estimator" in modules
    assert "ispom.estimators.modern.monocular.estimator" not in modules
    assert not [name for name in modules if name.startswith(OTHERS)]
