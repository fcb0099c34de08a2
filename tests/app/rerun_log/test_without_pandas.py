"""A recording does not bring pandas, and pandas still works beside it."""

from __future__ import annotations

import subprocess
import sys

SCRIPT = """
import sys
import numpy as np, pyarrow
from ispom_app.views.rerun.without_pandas import spare_pandas
finders = list(sys.meta_path)
spare_pandas()
assert sys.meta_path == finders
assert pyarrow.array(np.arange(3.0)).to_pylist() == [0, 1, 2]
import ispom_app.views.rerun.streams
import rerun as rr
rr.Points3D(np.zeros((3, 3))), rr.Scalars(1.0)
print("pandas" in sys.modules)
try:
    import pandas
except ModuleNotFoundError:
    sys.exit()
spare_pandas()
print(list(pyarrow.table({"a": [1, 2]}).to_pandas()["a"]))
"""


def test_recording_leaves_pandas_alone() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == "False" and lines[1:] in ([], ["[1, 2]"])
