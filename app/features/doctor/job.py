"""One examination: it has a limit of time and shows its progress, and may be cancelled between two pieces of work."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from ispom.evaluation.doctor.diagnose import diagnose, with_reruns
from ispom.evaluation.doctor.examination import examination
from ispom.evaluation.doctor.finding import Diagnosis
from ispom.evaluation.doctor.suspects import SUSPECTS
from ispom.types import Sequence

from .origin import Origin
from .rerun import rerun
from .stretch import Stretch


@dataclass(frozen=True)
class Progress:
    """How far it is."""

    done: int
    total: int
    doing: str
    """What is done now, in words."""


def examine(
    sequence: Sequence,
    stretch: Stretch,
    seconds: float,
    report: Callable[[Progress], None] = lambda progress: None,
    clock: Callable[[], float] = time.monotonic,
    origin: Origin | None = None,
) -> Diagnosis:
    """Returns the diagnosis of a stretch; where there is a run, at last it is forked and rerun with other settings.

    `report` is called between two pieces of work; what it raises ends the examination. After `seconds` no new suspect
    is examined, and no frame rerun; what was left out is in the diagnosis, and only this depends on the time.
    """
    start, count = clock(), stretch.last - stretch.first + 1
    total, done = count + len(SUSPECTS) + (origin is not None), 0

    def read() -> None:
        nonlocal done
        done += 1
        report(Progress(done, total, "reading images"))

    def next_suspect(name: str) -> bool:
        nonlocal done
        report(Progress(done, total, f"testing whether {name}"))
        done += 1
        return clock() - start < seconds

    seen = examination(sequence, stretch.first, stretch.last, read)
    found = diagnose(seen, SUSPECTS, next_suspect)
    if origin is None:
        return found

    def next_frame(doing: str) -> bool:
        report(Progress(total, total, doing))
        return clock() - start < seconds

    return with_reruns(found, rerun(origin, stretch, next_frame))
