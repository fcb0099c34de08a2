"""Arrow and Rerun are loaded with the allocators that a recording chooses for them, and nothing else is."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

SCRIPT = """
import os
before = dict(os.environ)
import ispom_app.views.rerun
import pyarrow
print(pyarrow.default_memory_pool().backend_name, dict(os.environ) == before)
"""


@pytest.mark.parametrize(("given", "found"), [({}, "system"), ({"ARROW_DEFAULT_MEMORY_POOL": "mimalloc"}, "mimalloc")])
def test_what_the_user_has_not_chosen(given: dict[str, str], found: str) -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], check=True, env=os.environ | given, capture_output=True)
    assert done.stdout.decode().split() == [found, "True"]
