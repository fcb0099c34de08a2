"""Tracks: a table of those in the picture, and a chart of how long they lived."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.types import TrackStatus

from ...engine.inspection.looked import EXPOSURES, Looked
from ...engine.inspection.selection import Selection
from ...engine.inspection.sightings import Seen
from ...presentation import colours
from ...presentation.texts import length
from ...views.viser.panels import renderer


@dataclass(frozen=True, eq=False)
class Lifetimes:
    """The tracks of some frames of one camera, in the order in which they began."""

    indices: NDArray[np.int64]
    """(E,) the frames, increasing."""
    ids: NDArray[np.int64]
    """(N,)."""
    first: NDArray[np.int64]
    """(N,) place among the frames of the first that has the track."""
    last: NDArray[np.int64]
    """(N,) the same of the last."""
    status: NDArray[np.uint8]
    """(N,) TrackStatus in the last."""


def lifetimes(exposures: Iterable[Seen]) -> Lifetimes:
    """Of these frames, oldest first."""
    views = list(exposures)
    none = np.zeros(0, np.int64)
    ids = np.concatenate([none, *(seen.tracks.ids for seen in views)])
    status = np.concatenate([none.astype(np.uint8), *(seen.tracks.status for seen in views)])
    places = np.repeat(np.arange(len(views)), [len(seen.tracks) for seen in views])
    found, first = np.unique(ids, return_index=True)
    last = len(ids) - 1 - np.unique(ids[::-1], return_index=True)[1]
    order = np.lexsort([found, places[last], places[first]])
    indices = np.array([seen.index for seen in views], np.int64)
    return Lifetimes(
        indices, found[order], places[first][order], places[last][order], status[last][order].astype(np.uint8)
    )


def endings(of: Lifetimes) -> dict[TrackStatus, int]:
    """How many ended for which reason, the most first; those that go on are not among them."""
    counts = np.bincount(of.status, minlength=len(TrackStatus))
    found = {status: int(counts[status]) for status in TrackStatus if status.dropped and counts[status]}
    return dict(sorted(found.items(), key=lambda item: -item[1]))


render = renderer(__package__)

MOST_ROWS, MOST_LINES = 40, 240
WIDTH, LINE = 330.0, 2.0
"""Width of the chart, and height of one line in it."""
NO_TRACKS = "No tracks in this picture."


def tracks_table(looked: Looked) -> str:
    """The tracks with the largest residuals first, as HTML."""
    if looked.seen is None:
        return render("tracks.html", note=NO_TRACKS)
    tracks, method = looked.seen.tracks, looked.seen.step.method
    order = np.argsort(np.where(np.isfinite(tracks.residual_px), -tracks.residual_px, np.inf), kind="stable")
    known, unit_m = looked.knowledge, looked.unit_m(method)
    at = {int(number): i for i, number in enumerate(known.ids)}
    rows = []
    for row in order[:MOST_ROWS].tolist():
        number, status = int(tracks.ids[row]), TrackStatus(int(tracks.status[row]))
        depth, residual = float(known.depths[at[number]]), float(tracks.residual_px[row])
        text = "" if np.isnan(depth) else f"{depth:.3g} units" if unit_m is None else length(unit_m * depth)
        rows.append(
            {
                "what": f"track:{method}:{number}",
                "number": number,
                "colour": colours.css(colours.TRACK[status]),
                "state": status.reason,
                "age": int(known.ages[at[number]]),
                "residual": "" if np.isnan(residual) else f"{residual:.2f}",
                "depth": text,
            }
        )
    selected = str(looked.selection or "")
    return render("tracks.html", note="", rows=rows, count=len(tracks), selected=selected, label=colours.label(method))


def lifetimes_chart(looked: Looked) -> str:
    """A line for each track, from its first to its last frame, coloured by why it ended, as HTML."""
    found = lifetimes(looked.recent[-EXPOSURES:])
    if looked.seen is None or not len(found.ids):
        return render("lifetimes.html", note=NO_TRACKS)
    lines = list(_lines(found, looked.seen.step.method, looked.selection))
    legend = [(colours.css(colours.TRACK[s]), f"{n} {s.reason}") for s, n in endings(found).items()]
    alive = int((found.status < TrackStatus.LOST).sum())
    living = (colours.css(colours.TRACK[TrackStatus.ALIVE]), f"{alive} go on")
    height, shown = LINE * len(lines), f", {len(lines)} of them drawn" if len(lines) < len(found.ids) else ""
    title = f"{len(found.ids)} tracks over {len(found.indices)} frames{shown}: {colours.label(looked.seen.step.method)}"
    ends = int(found.indices[0]), int(found.indices[-1])
    known = {"lines": lines, "legend": [living, *legend], "width": WIDTH, "height": height, "ends": ends}
    return render("lifetimes.html", note="", title=title, **known)


def _lines(found: Lifetimes, method: str, selected: Selection | None) -> Iterator[dict[str, Any]]:
    chosen = np.unique(np.linspace(0, len(found.ids) - 1, min(MOST_LINES, len(found.ids))).astype(int))
    if selected is not None and selected.kind == "track":
        chosen = np.unique(np.concatenate([chosen, np.flatnonzero(found.ids == selected.number)]))
    step = WIDTH / max(len(found.indices), 1)
    for place, i in enumerate(chosen.tolist()):
        status, number = TrackStatus(int(found.status[i])), int(found.ids[i])
        goes_on = TrackStatus.ALIVE if not status.dropped else status
        yield {
            "what": f"track:{method}:{number}",
            "hint": f"track {number}: {status.reason if status.dropped else 'goes on'}",
            "colour": colours.css(colours.TRACK[goes_on]),
            "x": round(float(found.first[i] * step), 1),
            "y": (place + 0.5) * LINE,
            "length": round(float((found.last[i] - found.first[i] + 1) * step), 1),
            "selected": selected is not None and selected.kind == "track" and selected.number == number,
        }
