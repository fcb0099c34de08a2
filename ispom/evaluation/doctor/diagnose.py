"""Examines all suspects and ranks them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from ispom.blas import one_thread

from .adjustment import LOSS_PX
from .diagnosis import Diagnosis
from .examination import Examination
from .finding import Ranked, Suspect
from .reruns import Reruns
from .suspects import SUSPECTS
from .suspects.calibration import SURE

MOST = 0.5
"""Share of the cost of held-out tracks from which on a calibration explains most of their error."""
CERTAIN = 8.0
"""Improvement of held-out tracks by a calibration, in standard errors, from which on it is beyond doubt."""
SEEN, MAY = frozenset({"images", "times", "tracks"}), frozenset({"too-fast"})
"""Kinds of evidence that need no calibration, and keys of those suspects that may hinder a method without being the
cause."""


def diagnose(
    seen: Examination,
    suspects: Iterable[Suspect] = SUSPECTS,
    advance: Callable[[str], bool] = lambda name: True,
) -> Diagnosis:
    """Returns the ranking of these suspects. The same stretch gives the same ranking.

    `advance` is called before each suspect with its name. If it returns False, this suspect and the later ones are
    skipped, as no time is left. It may raise to end the work.
    """
    one_thread()
    ranked, silent, left = [], [], []
    for suspect in suspects:
        known = suspect.how == "sensors" and seen.has_judged  # all of these at once
        if not known and (left or not advance(suspect.name)):
            left.append(suspect.key)
            continue
        finding = suspect.examine(seen)
        if finding is None:
            silent.append(suspect.key)
        else:
            ranked.append(Ranked(suspect, finding))
    ranked = _in_order(ranked)
    first, last = (seen.shots[0].index, seen.shots[-1].index) if seen.shots else (0, 0)
    return Diagnosis(first, last, tuple(ranked), tuple(silent), tuple(left), rivals=_rivals(seen, ranked))


def ordered(found: Diagnosis) -> Diagnosis:
    """Returns the diagnosis with its suspects in the order of their evidence, where findings were changed."""
    return replace(found, ranked=tuple(_in_order(found.ranked)))


def _rivals(seen: Examination, ranked: list[Ranked]) -> tuple[str, ...]:
    """Returns the keys of causes that explain the tracks as well as the first one, as far as they can tell."""
    keys = [each.suspect.key for each in ranked if each.finding.found]
    if not keys or keys[0] not in seen.outcomes:
        return ()
    first = seen.outcomes[keys[0]]
    return tuple(key for key in keys[1:] if key in seen.outcomes and first.better_than(seen.outcomes[key]) < SURE)


def with_reruns(found: Diagnosis, reruns: Reruns) -> Diagnosis:
    """Returns the diagnosis with the settings of reruns among its suspects."""
    found = replace(found, **{"set_back" if reruns.set_back else "reruns": reruns})
    return ordered(replace(found, ranked=(*found.ranked, *reruns.ranked)))


def _in_order(ranked: Iterable[Ranked]) -> list[Ranked]:
    """Returns causes before other suspects, those with more direct evidence first, and of these the strongest first.

    1. A setting of the run, because a better run without it was observed, not concluded.
    2. A calibration that explains most of the error of the tracks: the images cannot be the cause then.
    3. Causes in images and times, and moving objects.
    4. A calibration that explains a part, because it is tested fairly only on good images of a rigid scene. If the only
       other cause is a motion that may be too fast, a calibration beyond doubt comes before it.

    A fault of another sensor was measured by itself. It comes before causes in images if a method of the run uses that
    sensor, else last.
    """
    given = list(ranked)
    good = not any(each.finding.found and each.suspect.how in SEEN and each.suspect.key not in MAY for each in given)

    def place(each: Ranked) -> tuple[bool, float, float]:
        finding, values = each.finding, each.finding.values
        order = {"setting": 0.0, "images": 3.0, "times": 3.0, "tracks": 4.0}.get(each.suspect.how, 5.0)
        if each.suspect.how == "sensors":
            order = 2.5 if values.get("used") else 6.0
        if values.get("after_px", LOSS_PX) < LOSS_PX:
            order = 1.0 if values["gain"] > MOST else 2.0 if good and values.get("z", 0.0) > CERTAIN else order
        return not finding.found, order if finding.found else 0.0, -finding.strength

    return sorted(given, key=place)
