"""The branches of a run: what each differs in from the one that it was forked from, and how they compare."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

from ispom.evaluation.trajectory_error import TrajectoryError
from ispom.geometry import Similarity
from ispom.methods import Config, with_dependencies

from ...engine.error_curve import ErrorCurve
from ...engine.history.history import HistoryUsage
from ...engine.model.run_model import RunModel, Tally
from ...presentation.colours import Rgb

FIRST = "first run"
"""Name of the branch that was started from the first frame."""
STORED = "stored run"
"""Name of a branch that was read from its folder."""
COLOURS = ((124, 179, 66), (86, 180, 233), (204, 121, 167), (148, 138, 40), (0, 158, 115), (150, 90, 210))
"""Colours of the branches; they repeat."""
MOST = 12
"""Limit on the number of branches; each needs memory and files."""
NAME_LENGTH = 40


@dataclass(frozen=True, eq=False)
class Measured:
    """Accuracy and computing times of a branch when they were measured last: see `accuracy.py`."""

    errors: Mapping[str, TrajectoryError] = field(default_factory=dict)
    """Errors by method, of the trajectory as it is known now; none without ground truth, or with too few poses."""
    curves: Mapping[str, ErrorCurve] = field(default_factory=dict)
    """By method that has an error: its position error at each frame. Forks of one run are aligned together."""
    seconds: Mapping[str, float] = field(default_factory=dict)
    """By method: median computing time of a frame [s]."""


NOTHING = Measured()


@dataclass(frozen=True)
class Branch:
    """A run as the page lists it."""

    number: int
    """Its identity; 0 is the run that was started from the first frame."""
    name: str
    parent: int | None = None
    at: int = 0
    """The first frame that it computed itself."""
    changes: tuple[str, ...] = ()
    """What differs from its parent: "stereo.max-tracks 500 -> 300", "monocular off"."""
    computed: int = 0
    """Number of computed frames, including those of its parent."""
    tally: Tally = Tally()
    measured: Measured = NOTHING
    history_usage: HistoryUsage = HistoryUsage()
    hidden: bool = False
    """Whether it is not drawn while another is shown."""
    reproducible: bool = False
    """Whether it can be deleted without loss: a lesson makes it again, or its run is in a folder."""

    @property
    def colour(self) -> Rgb:
        return COLOURS[self.number % len(COLOURS)]


@dataclass(frozen=True, eq=False)
class BranchInView:
    """A branch as it is drawn at the frame at which another branch is shown."""

    model: RunModel
    placements: Mapping[str, Similarity]
    """By method, as Stepped.placements."""
    colour: Rgb


def changes(before: tuple[tuple[str, ...], Config], after: tuple[tuple[str, ...], Config]) -> tuple[str, ...]:
    """Returns a phrase for each difference between (methods, settings) of a run and of its fork."""
    (old_methods, old), (new_methods, new) = before, after
    switched = [f"{m} off" for m in old_methods if m not in new_methods]
    switched += [f"{m} on" for m in new_methods if m not in old_methods]
    for name in with_dependencies(new_methods):
        switched += differences(name, old.of(name), new.of(name))
    return tuple(switched)


def differences(where: str, old: Any, new: Any) -> tuple[str, ...]:
    """Returns a phrase `FLAG OLD → NEW` for each difference between two settings of a method, or of a part of it."""
    found: list[str] = []
    for setting in fields(new):
        a, b, flag = getattr(old, setting.name), getattr(new, setting.name), f"{where}.{setting.name.replace('_', '-')}"
        if is_dataclass(b):
            found += differences(flag, a, b)
        elif a != b:
            found.append(f"{flag} {_text(a)} → {_text(b)}")
    return tuple(found)


def _text(value: Any) -> str:
    return {True: "on", False: "off"}[value] if isinstance(value, bool) else str(value)
