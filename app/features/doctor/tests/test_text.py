"""The diagnosis as the page shows it: what was found is in sight, everything else folded."""

from __future__ import annotations

from ispom_app.features.doctor.panel import text_of
from ispom_app.features.doctor.state import Examined
from ispom_app.features.doctor.stretch import Stretch

from ispom.evaluation.doctor.finding import Diagnosis, Finding, Ranked
from ispom.evaluation.doctor.suspects import SUSPECTS


def test_what_was_not_found_is_folded() -> None:
    there, other = (
        Ranked(s, Finding(strength, f"of {s.key}")) for s, strength in zip(SUSPECTS, (2.0, 0.5), strict=False)
    )
    text = text_of(Examined(Stretch(0, 9, 5), None, Diagnosis(0, 9, (there, other), ("clock",))))
    seen, folded = text.split("<details")
    assert there.suspect.remedy in seen and f"of {there.suspect.key}" in seen
    assert f"of {other.suspect.key}" in folded and f"of {other.suspect.key}" not in seen and "clock" in folded
