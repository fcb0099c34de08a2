"""The runs of lessons without a page: each once, however many steps ask for it."""

from __future__ import annotations

from functools import cache

from ispom_app.engine.options import SourceOptions
from ispom_app.engine.playback import Playback
from ispom_app.features.lessons.lesson import OWN, Lesson, RunRequest, Step
from ispom_app.features.lessons.ran import Ran
from ispom_app.features.lessons.reveal import Revealed, revealed
from ispom_app.features.lessons.service import ran
from ispom_app.session.current_run import CurrentRun

from ispom.types import Sequence

BYTES = 100_000_000
_RAN: dict[tuple[str, int | None, int], Ran] = {}


def shown(lesson: Lesson, seed: int) -> list[tuple[Step, Revealed]]:
    """Each step, and what it reveals."""
    return [(step, revealed(step, runs_of(step, seed))) for step in lesson.steps]


def runs_of(step: Step, seed: int) -> dict[str, Ran]:
    return {name: _ran(request, step.to, seed) for name, request in {OWN: step.own, **step.runs}.items()}


def _ran(asked: RunRequest, to: int | None, seed: int) -> Ran:
    key = (repr(asked), to, seed)
    if key not in _RAN:
        run = CurrentRun(Playback(_sequence(asked.source, seed), asked.methods, asked.config), BYTES)
        for _ in range(len(run.playback.sequence) if to is None else to + 1):
            run.step()
        _RAN[key] = ran(run)
    return _RAN[key]


@cache
def _sequence(source: str, seed: int) -> Sequence:
    return SourceOptions(seed=seed).open(source)
