"""What may hinder a method is no cause where the run had no trouble; everything else stays."""

from __future__ import annotations

from ispom_app.features.doctor.job import without_harmless

from ispom.evaluation.doctor.diagnosis import Diagnosis
from ispom.evaluation.doctor.finding import Finding, Ranked
from ispom.evaluation.doctor.suspects import SUSPECTS

BY_KEY = {suspect.key: suspect for suspect in SUSPECTS}


def test_a_motion_that_troubled_nobody_is_no_cause() -> None:
    strengths = {"too-fast": 2.1, "on-lens": 1.3, "blur": 1.2, "darkness": 0.3}
    found = Diagnosis(0, 9, tuple(Ranked(BY_KEY[key], Finding(value, "So.")) for key, value in strengths.items()))
    judged = without_harmless(found)
    assert [each.suspect.key for each in judged.causes] == ["blur"]
    assert {each.suspect.key for each in judged.ranked} == set(strengths)
    assert {each.suspect.key: each.finding.strength for each in judged.ranked}["darkness"] == 0.3
