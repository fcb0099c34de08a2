"""What the page's time axis shows of a run, sent in increments: a page gets each frame once."""

from __future__ import annotations

from typing import Any

import numpy as np

from ispom.types import Status

from ...engine.conditions.evaluate import matches
from ...engine.conditions.parser import Expression
from ...engine.events import Bookmark
from ...engine.history.series import Series
from ...engine.run_events.event import RunEvent
from ...features.bookmarks.service import Bookmarks
from ...features.branches.branches import Branch
from ...features.branches.state import Branches
from ...features.breakpoints.commands import Breakpoints
from ...features.lessons.state import Lessons
from ...presentation import colours
from ...session.current_run import CurrentRun
from ...session.state import State

CODES = {"video": "v", "stereo": "s", "cameras": "c", "imu": "i", "gnss": "g", "wheel": "w", "laser": "l"}
"""Letters of the kinds in the page's axis; `o` for those of packages."""
SLICE = 500
"""Frames at which a condition is evaluated for one message; each takes some 10 microseconds."""


class AxisNews:
    """What one page knows so far."""

    def __init__(self) -> None:
        self._run: tuple[CurrentRun | None, bool] = (None, False)
        """And whether an open question of a lesson covers what its methods did."""
        self._branches: tuple[Branch, ...] = ()
        self._bookmarks: tuple[Bookmark, ...] = ()
        self._marked: Expression | None = None
        self._read = self._computed = self._matched = 0
        """Frames whose times, results and matches the page has."""
        self._sent_events = 0
        """The number of events that the page has."""

    def since(self, state: State, run: CurrentRun | None) -> dict[str, Any] | None:
        """What is new to the page; None where nothing is."""
        if run is None:
            return None
        news: dict[str, Any] = {}
        covers = state[Lessons].covers
        methods = () if covers else run.opened.methods
        if (run, covers) != self._run:
            self._run, self._marked, self._branches, self._bookmarks = (run, covers), None, (), ()
            self._read = self._computed = self._matched = self._sent_events = 0
            news["methods"] = [{"label": colours.label(m), "colour": colours.css(colours.of(m))} for m in methods]
        news |= (
            self._exposures(run) | self._results(run, methods) | self._matches(state[Breakpoints].marked, run.series)
        )
        news |= {} if covers else self._events(run)
        if state[Branches].all != self._branches:
            before, self._branches = self._points(), state[Branches].all
            news |= {"branches": self._points()} if self._points() != before else {}
        if state[Bookmarks].marks != self._bookmarks:
            self._bookmarks = state[Bookmarks].marks
            news["bookmarks"] = [{"at": b.exposure, "note": b.note} for b in state[Bookmarks].marks]
        return news or None

    @property
    def behind(self) -> bool:
        """Whether there is more to send, without anything having changed."""
        return self._marked is not None and self._matched < self._computed

    def _points(self) -> list[dict[str, Any]]:
        """Where branches begin."""
        forks = (b for b in self._branches if b.parent is not None)
        return [{"name": b.name, "at": b.at, "colour": colours.css(b.colour)} for b in forks]

    def _exposures(self, run: CurrentRun) -> dict[str, Any]:
        sequence, start = run.playback.sequence, self._read
        self._read = len(sequence)
        if start == self._read:
            return {}
        times_ms = (sequence.times_ns[start : self._read] - sequence.times_ns[0]) // 1_000_000
        return {
            "times_ms": times_ms.tolist(),
            "kinds": "".join(CODES.get(kind, "o") for kind in sequence.kinds[start : self._read]),
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

    def _matches(self, marked: Expression | None, series: Series) -> dict[str, Any]:
        """A slice of the frames at which the condition holds."""
        if marked is not None and any(q.name not in series.quantities for q in marked.quantities):
            marked = None  # of a branch without that method
        news: dict[str, Any] = {}
        if marked != self._marked:
            self._marked, self._matched = marked, 0
            news["condition"] = marked.text if marked is not None else ""
        if marked is not None and self._matched < self._computed:
            among = range(self._matched, min(self._matched + SLICE, self._computed))
            self._matched = among.stop
            if found := [i for i in among if matches(marked, series, i)]:
                news["matches"] = found
        return news


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
