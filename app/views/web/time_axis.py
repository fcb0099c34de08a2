"""What the page's time axis shows of a run, sent in increments: a page gets each frame once.

Features mark frames on it: `features/NAME/axis.py` has the kinds of `Marks` in `MARKS`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from string import ascii_letters
from typing import Any, ClassVar, Literal

import numpy as np

from ispom.sensors import SENSOR_KINDS
from ispom.types import Status

from ...engine.history.series import Series
from ...engine.run_events.event import RunEvent
from ...presentation import colours
from ...session.current_run import CurrentRun
from ...session.registry import modules
from ...session.state import State
from .news import Look, News

FRAMES, OTHER = {"video": "v", "stereo": "s", "cameras": "c"}, "o"
"""Letters of the kinds of frames in the page's axis, and of measurements of no registered kind."""


def sensor_letters() -> dict[str, str]:
    """Returns the letters of the registered kinds of sensors: each of its name, or else any that is free."""
    found = dict(FRAMES, other=OTHER)
    for name in SENSOR_KINDS.names():
        letters = (letter for letter in (*name, *ascii_letters) if letter.isalpha())
        found[name] = next((letter for letter in letters if letter not in found.values()), OTHER)
    return {name: found[name] for name in SENSOR_KINDS.names()}


@dataclass(frozen=True)
class Mark:
    """A frame that is marked."""

    at: int
    text: str
    """What is said where a person points at it."""
    note: str = ""
    """A person's own words about it."""
    colour: str = ""
    """As CSS writes it; empty for the page's own."""


class Marks:
    """One kind of marks, and what one page has of them. Made again for each run that a page shows."""

    name: ClassVar[str]
    sign: ClassVar[Literal["diamond", "flag", "row"]]
    """How they are drawn: a diamond or a flag with a line over all rows, or a row of their own."""

    def __init__(self) -> None:
        self._sent: tuple[Mark, ...] = ()

    def marked(self, state: State, run: CurrentRun) -> Iterable[Mark]:
        """All of them, in the order of their frames."""
        raise NotImplementedError(type(self).__name__)

    def since(self, state: State, run: CurrentRun) -> dict[str, Any] | None:
        """What is new to the page; None where nothing is.

        `marks` are all of them, or with `more` those that come to the ones before. A row has its `label`, none for no
        row, and `help`. Where more is left than one message takes, it is never None.
        """
        marks = tuple(self.marked(state, run))
        if marks == self._sent:
            return None
        self._sent = marks
        return {"sign": self.sign, "marks": [asdict(mark) for mark in marks]}


class AxisNews(News):
    """What one page knows so far."""

    def __init__(self) -> None:
        self._run: tuple[CurrentRun | None, bool] = (None, False)
        """And whether an open question of a lesson covers what its methods did."""
        self._letters: Mapping[str, str] = {}
        """By the kind of measurement."""
        self._marks: list[Marks] = []
        self._read = self._computed = 0
        """Frames whose times and results the page has."""
        self._sent_events = 0
        """The number of events that the page has."""

    def of(self, look: Look) -> Mapping[str, Any]:
        found = self.since(look.state, look.run)
        return {} if found is None else {"axis": found}

    def since(self, state: State, run: CurrentRun | None) -> dict[str, Any] | None:
        """What is new to the page; None where nothing is."""
        if run is None:
            return None
        news: dict[str, Any] = {}
        covers = state.covers
        methods = () if covers else run.opened.methods
        if (run, covers) != self._run:
            self._run = (run, covers)
            self._marks = [kind() for module in modules("axis") for kind in module.MARKS]
            self._read = self._computed = self._sent_events = 0
            self._letters = FRAMES | sensor_letters()
            labels = {letter: SENSOR_KINDS.get(name).label for name, letter in sensor_letters().items()}
            news["sensors"] = {**labels, OTHER: "Others"}
            news["methods"] = [{"label": colours.label(m), "colour": colours.css(colours.of(m))} for m in methods]
        news |= self._exposures(run) | self._results(run, methods)
        news |= {} if covers else self._events(run)
        marks = {kind.name: found for kind in self._marks if (found := kind.since(state, run)) is not None}
        return news | ({"marks": marks} if marks else {}) or None

    def _exposures(self, run: CurrentRun) -> dict[str, Any]:
        sequence, start = run.playback.sequence, self._read
        self._read = len(sequence)
        if start == self._read:
            return {}
        times_ms = (sequence.times_ns[start : self._read] - sequence.times_ns[0]) // 1_000_000
        return {
            "times_ms": times_ms.tolist(),
            "kinds": "".join(self._letters.get(kind, OTHER) for kind in sequence.kinds[start : self._read]),
        }

    def _results(self, run: CurrentRun, methods: tuple[str, ...]) -> dict[str, Any]:
        start, self._computed = self._computed, len(run.series)
        if start == self._computed:
            return {}
        results = [_result(run.series, method, start, self._computed) for method in methods]
        return {"computed": self._computed, "results": results}

    def _events(self, run: CurrentRun) -> dict[str, Any]:
        """Those that began since."""
        new = run.events.since(self._sent_events)
        self._sent_events += len(new)
        entries = [{"at": e.frame, "severity": e.severity, "text": _text(e)} for e in new]
        return {"events": entries} if entries else {}


def _result(series: Series, method: str, start: int, stop: int) -> dict[str, Any]:
    """Of these frames: those at which a method made a keyframe, and stretches (first, last) where it is lost."""
    status = series.quantities[f"{method}.status"]
    lost = series.values(status.name, start, stop) == status.choices.index(Status.LOST)
    return {
        "key_frames": (np.flatnonzero(series.values(f"{method}.key_frame", start, stop) == 1) + start).tolist(),
        "lost": [[int(first) + start, int(last) + start - 1] for first, last in _stretches(lost)],
    }


def _text(event: RunEvent) -> str:
    return f"{colours.label(event.method)}: {event.sentence}" if event.method else event.sentence


def _stretches(mask: np.ndarray) -> np.ndarray:
    """(K, 2) first index and one beyond the last of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    return edges.reshape(-1, 2)
