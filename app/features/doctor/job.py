"""One examination: it has a limit of time and shows its progress, and may be cancelled between two pieces of work."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from ispom.evaluation.doctor.diagnose import diagnose, ordered, with_reruns
from ispom.evaluation.doctor.diagnosis import Diagnosis
from ispom.evaluation.doctor.examination import examination
from ispom.evaluation.doctor.finding import Ranked
from ispom.evaluation.doctor.reruns import Reruns
from ispom.evaluation.doctor.suspects import SUSPECTS
from ispom.evaluation.doctor.suspects.calibration import WEAK
from ispom.types import Sequence

from ...engine.run_events.stretch import Stretch
from .origin import Origin
from .rerun import rerun, set_back
from .sensors import sensor_scene

SETTINGS = 0.6
"""Share of the time after which no setting is set back to its default any more."""


HINDERS = frozenset({"too-fast", "on-lens"})
"""Keys of suspects that are a trouble where they cost a method its pose, and else none."""


@dataclass(frozen=True)
class Progress:
    """How far it is."""

    done: int
    total: int
    doing: str
    """What is done now, in words."""
    known: Diagnosis | None = None
    """What would be answered so far; a setting may have had one rerun only."""


def examine(
    sequence: Sequence,
    stretch: Stretch,
    seconds: float,
    report: Callable[[Progress], None] = lambda progress: None,
    clock: Callable[[], float] = time.monotonic,
    origin: Origin | None = None,
) -> Diagnosis:
    """Returns the diagnosis of a stretch. Where there is a run, settings that differ from their defaults are set back
    in reruns first, which may take SETTINGS of the time. If none of them is the cause, the run is at last forked and
    rerun with other ones.

    `report` is called between two pieces of work; what it raises ends the examination. After `seconds` no new suspect
    is examined, and no frame rerun; what was left out is in the diagnosis, and only this depends on the time.
    """
    start, count = clock(), stretch.last - stretch.first + 1
    total, done = count + len(SUSPECTS) + (origin is not None), 0
    found = known = Diagnosis(stretch.first, stretch.last, ())

    def read() -> None:
        nonlocal done
        done += 1
        report(Progress(done, total, "reading images", known))

    def next_suspect(name: str) -> bool:
        nonlocal done
        report(Progress(done, total, f"testing whether {name}", known))
        done += 1
        return clock() - start < seconds

    def next_frame(doing: str) -> bool:
        report(Progress(done, total, doing, known))
        return clock() - start < (SETTINGS if not done else 1) * seconds

    def so_far(reruns: Reruns) -> None:
        nonlocal known
        known = with_reruns(found, reruns)

    settings = None if origin is None else set_back(origin, stretch, next_frame, so_far)
    seen = examination(sequence, stretch.first, stretch.last, read)
    if origin is not None:
        seen = replace(seen, sensors=sensor_scene(origin, sequence, stretch))
    found = diagnose(seen, SUSPECTS, next_suspect)
    if stretch.quiet and origin is not None:
        found = without_harmless(found)
    if settings is not None:
        found = with_reruns(found, settings)
    known = found
    return found if origin is None else with_reruns(found, rerun(origin, stretch, next_frame, settings, so_far))


def without_harmless(found: Diagnosis) -> Diagnosis:
    """Returns the diagnosis of a stretch in which the run had no warning and no loss: what may hinder did not."""

    def judged(each: Ranked) -> Ranked:
        if each.suspect.key not in HINDERS or not each.finding.found:
            return each
        text = f"{each.finding.evidence} The run had no trouble here, so this is no cause."
        return replace(each, finding=replace(each.finding, strength=WEAK, evidence=text))

    return ordered(replace(found, ranked=tuple(map(judged, found.ranked))))
