"""A long run, as the app keeps it: what is logged and kept for a frame does not depend on how many came before."""

from __future__ import annotations

import pytest

from tests.app.soak import walked

COUNT, BUDGET = 400, 2_000_000


@pytest.mark.parametrize("scenario", ["single camera", "pairs stop"])
def test_an_exposure_late_in_a_run_is_logged_as_one_early_in_it(scenario: str) -> None:
    """`walked` holds that the history stays within its budget, and that its first frame is still whole."""
    entries = [measured.entries for measured in walked(scenario, COUNT, BUDGET, None)]
    assert max(entries[COUNT // 2 :]) <= max(entries[100 : COUNT // 2]) + 1
