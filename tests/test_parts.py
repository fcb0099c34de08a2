"""Kernels and parts compute the same where numba compiles them in its own way, as a version not known yet does."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import njit
from numba.core.errors import NumbaError
from numba.core.runtime.nrt import rtsys

from ispom.kernels import kernel

PROGRAM = """
import numba
if NEWER:
    numba.version_info = numba.version_info._replace(short=(0, 999))
from ispom import kernels
import numpy as np
@kernels.part
def twice(x, k):
    return (2.0 * x[k], 1.0) if x[k] > 0 else (0.0, x[k])
@kernels.kernel(fastmath={"contract"})
def filled(x):
    out = np.zeros((len(x), 2))
    for k in range(len(x)):
        out[k, 0], out[k, 1] = twice(x, k)
    return out
print(filled(np.array([1.5, -3.0, 0.0])).tolist(), kernels.is_kept(filled), *filled.stats.cache_hits.values())
print(hasattr(numba.core.types.functions.BaseFunction.get_call_type, "__wrapped__"))
"""


@pytest.mark.parametrize("newer", [False, True])
def test_a_kernel_and_its_part(tmp_path: Path, newer: bool) -> None:
    source = tmp_path / "filled.py"
    source.write_text(PROGRAM.replace("NEWER", str(newer)))
    env = dict(os.environ, NUMBA_CACHE_DIR=str(tmp_path))
    for hits in ([], ["1"]):
        found = subprocess.run([sys.executable, str(source)], env=env, check=True, capture_output=True, text=True)
        assert found.stderr == ""
        told, remembers = found.stdout.splitlines()
        assert told == " ".join(["[[3.0, 1.0], [0.0, -3.0], [0.0, 0.0]] True", *hits])
        assert remembers == str(not newer)


def own(n: int) -> tuple[float, np.ndarray]:
    rows = np.full((n, 2), 1.5)
    rows[:, 1] = np.sort(np.array([3.0, 1.0, 2.0]))[:n]
    return np.median(rows.ravel()) + max(n, 1) + len(str(n)), np.vstack((rows, np.zeros_like(rows)))


def test_what_numba_writes_in_python_is_the_same_as_a_part() -> None:
    """In functions of others, too, which have steps that no kernel needs; all arrays are let go."""
    compiled = njit(own)
    nrt: Any = import_module("numba.core.runtime._nrt_python")
    nrt.memsys_enable_stats()
    before = rtsys.get_allocation_stats()
    for _ in range(3):
        (number, rows), (expected, expected_rows) = compiled(3), own(3)
        assert number == expected
        np.testing.assert_array_equal(rows, expected_rows)
    del rows
    after = rtsys.get_allocation_stats()
    nrt.memsys_disable_stats()
    assert after.alloc - before.alloc == after.free - before.free > 0
    with pytest.raises(ValueError, match="negative"):
        compiled(-1)


def test_what_no_kernel_has_is_an_error() -> None:
    with pytest.raises(NumbaError):
        kernel()(lambda n: [k * n for k in range(n)])(3)
