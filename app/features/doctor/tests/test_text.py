"""The diagnosis as the page and the terminal show it: what was found, everything else apart from it."""

from __future__ import annotations

from ispom_app.engine.run_events.stretch import Stretch
from ispom_app.features.doctor.state import Examined
from ispom_app.features.doctor.text import lines
from ispom_app.features.doctor.view import view_of
from ispom_app.features.doctor.written import written

from ispom.evaluation.doctor.diagnose import with_reruns
from ispom.evaluation.doctor.diagnosis import Diagnosis
from ispom.evaluation.doctor.finding import Finding, Ranked
from ispom.evaluation.doctor.reruns import Outcome, Reruns, Trial, Tried
from ispom.evaluation.doctor.suspects import SUSPECTS
from ispom.plausibility.doubt import Doubt


def test_what_was_not_found_is_folded() -> None:
    there, other = (
        Ranked(s, Finding(strength, f"of {s.key}")) for s, strength in zip(SUSPECTS, (2.0, 0.5), strict=False)
    )
    view = view_of(Examined(Stretch(0, 9, 5), None, Diagnosis(0, 9, (there, other), ("clock",))))
    assert [(each.remedy, each.evidence) for each in view.causes] == [(there.suspect.remedy, f"of {there.suspect.key}")]
    assert [each.evidence for each in view.others] == [f"of {other.suspect.key}"] and view.silent == ("clock",)


def test_reruns_are_a_table_and_rows_of_text() -> None:
    worse, better = (Outcome(40, dict.fromkeys(range(n), 0.3), 0, {"few": 40 - n}, 40 - n) for n in (10, 30))
    trials = (Tried(Trial("stereo", "window", 8, 16), (worse,), (worse,)),)
    trials += (Tried(Trial("stereo", "max_tracks", 50, 400), (better,) * 3, (worse,) * 3),)
    found = with_reruns(Diagnosis(0, 9, ()), Reruns(0, 9, trials, ("--stereo.min-share 0.8",)))
    (table,) = view_of(Examined(Stretch(0, 9, 5), None, found)).reruns
    helps = {row.option: row.helps for row in table.rows}
    assert helps["--stereo.max-tracks 400"] and not helps["--stereo.window 16"]
    printed = "\n".join(lines(found, Stretch(0, 9, 5)))
    assert printed.index("--stereo.max-tracks 400: 30 of 40") < printed.index("--stereo.window 16: 10 of 40")
    assert "--stereo.min-share 0.8" in printed and table.left == ("--stereo.min-share 0.8",)
    reruns = written(found, Stretch(0, 9, 5)).reruns
    assert reruns is not None and [row.helps for row in reruns.tried] == [False, True]
    assert reruns.unchanged[0].located == 10


def test_what_was_known_when_the_recording_was_opened_comes_first() -> None:
    notes = ("30 images per second assumed", Doubt("images_cut", "This looks like a cut."))
    first, *rest = lines(Diagnosis(0, 9, ()), Stretch(0, 9, 5), notes)
    assert notes[1] in first and not any(notes[0] in line for line in rest)
