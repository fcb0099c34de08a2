"""Examines all suspects and ranks them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from ispom.blas import one_thread

from .adjustment import LOSS_PX
from .examination import Examination
from .finding import Diagnosis, Ranked, Suspect
from .reruns import Reruns
from .suspects import SUSPECTS
from .suspects.calibration import SURE

MOST = 0.5
"""Share of the cost of held-out tracks from which on a calibration explains most of their error."""
CERTAIN = 8.0
"""Standard errors by which held-out tracks are better with a calibration, from which on it is beyond doubt."""
INDIRECT = frozenset({"too-fast"})
"""Keys of suspects of the images that say what may hinder, not that it did."""


def diagnose(
    seen: Examination,
    suspects: Iterable[Suspect] = SUSPECTS,
    advance: Callable[[str], bool] = lambda name: True,
) -> Diagnosis:
    """Returns the ranking of these suspects. The same stretch gives the same ranking.

    `advance` is called before each suspect with its name; where it returns False, no time is left for it and for those
    after it. It may raise to end the work.
    """
    one_thread()
    ranked, silent, left = [], [], []
    for suspect in suspects:
        if left or not advance(suspect.name):
            left.append(suspect.key)
            continue
        finding = suspect.examine(seen)
        if finding is None:
            silent.append(suspect.key)
        else:
            ranked.append(Ranked(suspect, finding))
    ranked.sort(key=_place)  # stable: at the same strength in the table's order
    first, last = (seen.shots[0].index, seen.shots[-1].index) if seen.shots else (0, 0)
    return Diagnosis(first, last, tuple(ranked), tuple(silent), tuple(left), rivals=_rivals(seen, ranked))


def _rivals(seen: Examination, ranked: list[Ranked]) -> tuple[str, ...]:
    """Returns the keys of causes that explain the tracks as well as the first one, as far as they can tell."""
    keys = [each.suspect.key for each in ranked if each.finding.found]
    if not keys or keys[0] not in seen.outcomes:
        return ()
    first = seen.outcomes[keys[0]]
    return tuple(key for key in keys[1:] if key in seen.outcomes and first.better_than(seen.outcomes[key]) < SURE)


def with_reruns(found: Diagnosis, reruns: Reruns) -> Diagnosis:
    """Returns the diagnosis with what reruns showed among its suspects."""
    ranked = tuple(sorted((*found.ranked, *reruns.ranked), key=_place))
    return replace(found, ranked=ranked, **{"set_back" if reruns.set_back else "reruns": reruns})


def _place(each: Ranked) -> tuple[bool, int, float]:
    """Causes before the others, those with the more direct evidence first.

    A setting of the run comes first: that without it the run goes better was seen, and not concluded. Then a
    calibration with which tracks fit that did not before: the images cannot be the trouble. Then what images and times
    show, a calibration with which tracks fit better beyond doubt, a motion that may be too fast, and what moves, before
    what a calibration explains in part: that is tested fairly only on good images of a rigid scene.
    """
    finding, suspect = each.finding, each.suspect
    order = {"setting": 0, "images": 2, "times": 2, "tracks": 5}.get(suspect.how, 6)
    order = 4 if suspect.key in INDIRECT else order
    gain, z = (finding.values.get(name, 0.0) for name in ("gain", "z"))
    if max(gain / MOST, z / CERTAIN) > 1 and finding.values["after_px"] < LOSS_PX:
        order = 1 if gain > MOST else 3
    return not finding.found, order if finding.found else 0, -finding.strength
