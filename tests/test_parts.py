"""Kernels and parts compute the same where numba compiles them in its own way, as a version not known yet does."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core.errors import NumbaError

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


def test_what_no_kernel_has_is_an_error() -> None:
    with pytest.raises(NumbaError):
        kernel()(lambda n: [k * n for k in range(n)])(3)
