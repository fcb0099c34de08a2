"""After the kernels of the list are compiled, nothing is left to compile, and nothing was in vain."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from ispom.kernel_list import kernel_list
from ispom.kernels import kernels
from ispom.types import Sequence

SCRIPT = """
import sys
from dataclasses import fields
from pathlib import Path
import numpy as np
from ispom.ensemble import build
from ispom.methods import Config, default_methods
from ispom.kernel_list import kernel_list, kernels_of
from ispom.kernels import compile_kernel, kernels
from ispom.sequences.formats.simulated import open_simulated

METHODS = ("monocular", "stereo", "integrated")
for name in kernels_of(METHODS):
    compile_kernel(name, kernel_list()[name].types)
compiled = {kernel: list(kernel.signatures) for kernel in kernels()}
flight = open_simulated("tiny", seed=0, cache_dir=Path(sys.argv[1]), duration_s=2.4)
ensemble = build(Config(), default_methods(flight.rig), flight.rig)
state = ensemble.start()
for i in range(60):
    exposure = flight[i]
    for field in fields(exposure):
        if i % 2 and isinstance(value := getattr(exposure, field.name), np.ndarray):
            value.setflags(write=False)  # as images of files are
    state, _ = ensemble.step(state, exposure)
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
    """The modules of the list are there, with these kernels in them."""
    known = set[str]()
    for name in kernel_list():
        module, function = name.rsplit(".", 1)
        assert getattr(import_module(f"ispom.{module}"), function) in kernels()
        known.add(name)
    assert {"solvers.localisation._normal", "solvers.window.kernels.reduce_points"} <= known
