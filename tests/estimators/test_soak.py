"""A long run holds no more than a short one: what States hold is counted, no time is measured (soak.py does that)."""

from __future__ import annotations

import pytest

from tests.estimators.soak import SCENARIOS, Scenario, laps

EXPOSURES = 1_200
LAPS = EXPOSURES // 100
GROWN = 1.1
STANDING = ("monocular still", "stereo goes blank", "integrated, pairs end", "integrated, video goes blank")
"""Of the scenarios those in which most could pile up."""


@pytest.mark.parametrize("variant", ["modern", "paper"])
@pytest.mark.parametrize("scenario", [s for s in SCENARIOS if s.name in STANDING], ids=lambda s: s.name)
def test_a_state_does_not_grow(scenario: Scenario, variant: str) -> None:
    found = laps(scenario, variant, EXPOSURES)  # type: ignore[arg-type]
    assert len(found) == LAPS
    early, late = found[LAPS // 2 : 3 * LAPS // 4], found[3 * LAPS // 4 :]
    assert max(lap.arrays for lap in late) <= GROWN * max(lap.arrays for lap in early)
    assert max(lap.values for lap in late) <= GROWN * max(lap.values for lap in early)
