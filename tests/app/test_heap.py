"""What is free is given back."""

from __future__ import annotations

import sys

import psutil
import pytest
from ispom_app.headless.heap import give_back


@pytest.mark.skipif(sys.platform != "linux", reason="glibc alone")
def test_free_memory_between_pieces_in_use_is_given_back() -> None:
    pieces = [bytearray(50_000) for _ in range(2_000)]
    kept = pieces[::100]
    del pieces
    before = psutil.Process().memory_info().rss
    give_back()
    assert before - psutil.Process().memory_info().rss > 60e6
    assert len(kept) == 20
