"""Numba's own compiled code is kept, too, and is what kernels count references with."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

COUNT = """
import numpy as np
from numba.core.codegen import JITCodeLibrary
from ispom.kernels import kernel
optimised = []
plain = JITCodeLibrary._optimize_final_module
JITCodeLibrary._optimize_final_module = lambda library: (optimised.append(library.name), plain(library))
@kernel()
def split(x):
    halves = x[:2] + 1, x[2:].copy()
    return halves[0], halves
first, halves = split(np.arange(4.0))
del halves
assert first.tolist() == [1, 2]
print(*optimised)
"""


def optimised(folder: Path) -> tuple[set[str], str]:
    """Names of what a process compiles that runs a kernel which makes arrays, and what it says."""
    source = folder / "count.py"
    source.write_text(COUNT)
    env = dict(os.environ, NUMBA_CACHE_DIR=str(folder))
    found = subprocess.run([sys.executable, str(source)], env=env, check=True, capture_output=True, text=True)
    return set(found.stdout.split()), found.stderr


def test_a_start_with_all_code_kept_compiles_nothing(tmp_path: Path) -> None:
    first, said = optimised(tmp_path)
    assert {"nrt", "split"} <= first and not said
    assert optimised(tmp_path) == (set(), "")
    (file,) = (tmp_path / "ispom").glob("numba.runtime-*.kernel")
    file.write_bytes(file.read_bytes()[:-1])
    names, said = optimised(tmp_path)
    assert names == {"nrt"} and "deleted" in said
