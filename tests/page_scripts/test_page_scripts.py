"""The page's scripts, tested by node without a browser: `node --test tests/page_scripts`."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.skipif(shutil.which("node") is None, reason="node is not here")
def test_node_finds_no_fault_in_the_pages_scripts() -> None:
    # Where a folder cannot be given, as from node 22 on, files can.
    files = sorted(map(str, Path(__file__).parent.glob("*.test.mjs")))
    done = subprocess.run(["node", "--test", *files], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-5000:]
