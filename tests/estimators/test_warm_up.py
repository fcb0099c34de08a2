"""After the warm-up nothing is left to compile."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core.dispatcher import Dispatcher

from ispom.estimators import warm_up
from ispom.types import Sequence

SCRIPT = """
import sys
from pathlib import Path
from ispom.estimators import Config, build, default_methods
from ispom.estimators.warm_up import compiled_before, kernels, warm_up
from ispom.sequences.simulated import open_simulated

warm_up()
assert compiled_before()
compiled = {kernel: list(kernel.signatures) for kernel in kernels()}
flight = open_simulated("tiny", seed=0, cache_dir=Path(sys.argv[1]), duration_s=2.4)
ensemble = build(Config(variant="modern"), default_methods(flight.rig, "modern"), flight.rig)
state = ensemble.start()
for i in range(60):
    state, _ = ensemble.step(state, flight[i])
for kernel in kernels():
    new = set(kernel.signatures) - set(compiled[kernel])
    assert not new, f"{kernel.py_func.__module__}.{kernel.py_func.__name__}: {new}"
"""


@pytest.mark.usefixtures("exposures")
def test_a_real_run_compiles_nothing_more(flight: Sequence, rendered: Path) -> None:
    command = [sys.executable, "-c", SCRIPT, str(rendered)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr


def test_kernels_are_known() -> None:
    names = {f"{k.py_func.__module__.removeprefix('ispom.')}.{k.py_func.__name__}" for k in warm_up.kernels()}
    assert {"solvers.motion_only._normal", "solvers.window_kernels.reduce_points"} <= names
    assert all(isinstance(k, Dispatcher) for k in warm_up.kernels())


def test_new_sources_are_to_be_compiled_again(tmp_path: Path) -> None:
    (tmp_path / "made.py").write_text("from numba import njit\n\n\n@njit(cache=True)\ndef one(x):\n    return x + 1\n")
    script = (
        "import os, made\n"
        "from ispom.estimators.warm_up import _kept, keep\n"
        "assert not _kept(made.one)\n"
        "made.one(1)\n"
        "assert _kept(made.one)\n"
        "os.utime(made.__file__, (2e9, 2e9))\n"
        "assert not _kept(made.one)\n"
        "keep(made.one)\n"
        "assert _kept(made.one)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr
