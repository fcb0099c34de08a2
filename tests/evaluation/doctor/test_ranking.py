"""Which of several causes comes first."""

from __future__ import annotations

from typing import cast

import pytest

from ispom.evaluation.doctor.diagnose import diagnose
from ispom.evaluation.doctor.examination import Examination
from ispom.evaluation.doctor.finding import Finding, How, Suspect


class Nothing:
    """A stretch of which no suspect here needs anything."""

    shots, outcomes = (), {}


def suspect(key: str, how: How, strength: float, **values: float) -> Suspect:
    return Suspect(key, key, how, "", lambda _: Finding(strength, "", values))


FAST = suspect("too-fast", "images", 2.1)
MOVING = suspect("moving-objects", "tracks", 2.0)
DECISIVE = suspect("pair-turned", "counterfactual", 15.0, gain=0.8, after_px=0.2)
PARTLY = suspect("mount-shifted", "counterfactual", 5.0, gain=0.25, after_px=0.3)
CERTAIN = suspect("pair-turned", "counterfactual", 4.4, gain=0.22, z=16.0, after_px=0.3)
LEVEL = suspect("unlevel-pair", "images", 6.3)
UNFIT = suspect("clock", "counterfactual", 12.0, gain=0.6, after_px=3.0)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (DECISIVE, FAST),
        (DECISIVE, MOVING),
        (CERTAIN, FAST),
        (MOVING, CERTAIN),
        (LEVEL, CERTAIN),
        (FAST, PARTLY),
        (FAST, UNFIT),
        (FAST, MOVING),
        (MOVING, PARTLY),
        (UNFIT, PARTLY),
    ],
)
def test_the_more_direct_evidence_comes_first(first: Suspect, second: Suspect) -> None:
    """A calibration is first only where it makes tracks fit that did not before."""
    for suspects in ((first, second), (second, first)):
        found = diagnose(cast(Examination, Nothing()), suspects)
        assert [each.suspect.key for each in found.causes] == [first.key, second.key]
