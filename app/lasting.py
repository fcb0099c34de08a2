"""Imports without looking for garbage in between: nearly all that they make lasts."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def lasting() -> Iterator[None]:
    """What is made meanwhile is never looked through: a seventh of the time until a command begins."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
