"""Has Arrow and Rerun give memory back to the system once it is free: both bring an allocator that keeps it for later.

What they hold for long is little, what passes through is much: chunks that wait to be written, and at a recording's end
its index. The libraries read these settings of theirs once, when they are loaded.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

SETTINGS = {"ARROW_DEFAULT_MEMORY_POOL": "system", "MIMALLOC_PURGE_DELAY": "0"}
"""Arrow takes memory as Python does, which costs 4 MB less; Rerun keeps what is free for 0 ms."""


def spare_memory() -> None:
    """Loads both; nothing, where they are there already."""
    with _environment():
        import pyarrow
        import rerun_bindings  # noqa: F401

        pyarrow.default_memory_pool()  # is chosen now


@contextmanager
def _environment() -> Iterator[None]:
    """With the settings that the user has not made; processes that are started later do not inherit them."""
    added = SETTINGS.keys() - os.environ.keys()
    os.environ.update({name: SETTINGS[name] for name in added})
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]
