"""Why did it go wrong at the frame shown? Progress, the ranking, and what reruns with other settings gave."""

from __future__ import annotations

import msgspec

from ispom.evaluation.doctor.diagnosis import Diagnosis
from ispom.evaluation.doctor.finding import Ranked
from ispom.evaluation.doctor.reruns import Reruns

from ...session.current_run import CurrentRun
from ...session.state import State
from ...views.web.view_values import View
from .rerun import NOT_SET_BACK, NOT_TRIED
from .state import Examined
from .text import SHOWN, rerun_table


class Suspect(msgspec.Struct, frozen=True):
    name: str
    state: str
    strength: float
    evidence: str
    undecided: str
    remedy: str
    frames: tuple[int, ...]
    """That show it."""


class Rerun(msgspec.Struct, frozen=True):
    """What one setting did to the stretch."""

    option: str
    helps: bool
    located: int
    frames: int
    segments: int
    failures: str


class RerunTable(msgspec.Struct, frozen=True):
    first: int
    last: int
    answer: str
    rows: tuple[Rerun, ...]
    left: tuple[str, ...]
    """Settings that were not tried."""


class DoctorView(msgspec.Struct, frozen=True):
    """The newest examination; `stretch` is None before the first one."""

    stretch: tuple[int, int] | None
    progress: str
    """How far it is, while it goes on."""
    problem: str
    answer: str
    """In place of causes, where none was found."""
    causes: tuple[Suspect, ...]
    others: tuple[Suspect, ...]
    reruns: tuple[RerunTable, ...]
    silent: tuple[str, ...]
    """Causes that the recording says nothing about."""
    left: tuple[str, ...]
    """Causes for which no time was left."""
    helped: bool
    """Whether a setting helped, with which the run can be forked."""
    untried: bool
    """Whether more time would show more."""


def doctor(state: State, run: CurrentRun | None, frame: int) -> DoctorView:
    """What the examination found so far."""
    return view_of(state[Examined].at(state) if run is not None else Examined())


def view_of(examined: Examined) -> DoctorView:
    """The same, of one examination."""
    found, stretch, progress = examined.diagnosis, examined.stretch, examined.progress
    ranked = () if found is None else found.ranked[:SHOWN]
    reruns = () if found is None else (found.set_back, found.reruns)
    return DoctorView(
        stretch=None if stretch is None else (stretch.first, stretch.last),
        progress="" if progress is None else f"{progress.done} of {progress.total}: {progress.doing}",
        problem=examined.problem,
        answer="" if found is None or found.causes else unexplained(found),
        causes=() if found is None else tuple(_suspect(each) for each in found.causes),
        others=tuple(_suspect(each) for each in ranked if not each.finding.found),
        reruns=tuple(_table(each) for each in reruns if each is not None),
        silent=() if found is None else tuple(found.silent),
        left=() if found is None else tuple(found.left),
        helped=found is not None and found.helped is not None,
        untried=found is not None and untried(found),
    )


def unexplained(found: Diagnosis) -> str:
    """The answer where there is no cause."""
    if found.undecided:
        return found.answer
    reruns = [each for each in (found.set_back, found.reruns) if each is not None]
    late = [each for each in reruns if each.note in (NOT_SET_BACK, NOT_TRIED)]
    tried = any(each.tried for each in reruns)
    settings = "Not all settings were tried." if late and tried else "Settings not tried." if late else ""
    others = ", no time was left for the others" if found.left else ""
    answers = [each.answer for each in reruns if each not in late]
    return " ".join(filter(None, (f"Not explained; {len(found.ranked)} causes tested{others}.", settings, *answers)))


def untried(found: Diagnosis) -> bool:
    """Whether more time would show more, where there is no cause."""
    reruns = [each for each in (found.set_back, found.reruns) if each is not None]
    late = any(each.note in (NOT_SET_BACK, NOT_TRIED) for each in reruns)
    return not found.causes and (late or bool(found.left))


def _suspect(each: Ranked) -> Suspect:
    finding = each.finding
    frames = tuple(int(frame) for frame in finding.frames)
    state, strength = str(finding.state), round(float(finding.strength), 2)
    return Suspect(each.suspect.name, state, strength, finding.evidence, finding.undecided, each.suspect.remedy, frames)


def _table(reruns: Reruns) -> RerunTable:
    rows = tuple(
        Rerun(option, helps, len(outcome.located), outcome.frames, outcome.segments, outcome.failures)
        for option, outcome, helps in rerun_table(reruns)
    )
    return RerunTable(reruns.first, reruns.last, reruns.answer, rows, tuple(reruns.left))


VIEWS = (View("doctor", "Explain", 101, doctor),)
