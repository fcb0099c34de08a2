"""Some of the cases that `python -m tests.fuzz` works through, evenly drawn."""

from __future__ import annotations

import sys

import pytest

STRANGERS = 1_000_000
CASES = [*range(0, 5000, 50), *range(STRANGERS, STRANGERS + 2000, 50)]


@pytest.mark.skipif(sys.platform == "win32", reason="limits of processor time and named pipes are POSIX's")
@pytest.mark.timeout(1800)
def test_every_mutated_input_is_a_success_or_one_sentence() -> None:
    from tests.fuzz.run import outcomes  # brings POSIX's limits

    faults = [f"case {number}: {what}\n{fault}" for number, what, fault in outcomes(CASES) if fault]
    assert not faults, "\n".join(faults)
