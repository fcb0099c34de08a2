"""A view of a run in a cell: one page without a server and without any address, and a link by which it tells Python
what is chosen.

    page    HTML with its script and all frames, in an iframe. It works in a stored notebook and in an exported one, too
    link    a widget that draws nothing in Jupyter and VS Code. Page and link speak over a channel of the browser
            (BroadcastChannel) whose name only they know

    page to link     hello: [number of each frame that it has]    chosen: {frame, tracks}
    link to page     state: {frame, tracks}                       news: what Python sends      hail: asks for hello
    Python to link   added: {frame, place}                        dropped: [numbers]

marimo shows the widget alone, so there the link has the page and draws it.
"""

from __future__ import annotations

import json
import math
import sys
from html import escape
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
import traitlets
from anywidget import AnyWidget

from ispom.errors import InputError
from ispom.methods import method as registered
from ispom.notebook.folders import StoredRun
from ispom.notebook.result import Result
from ispom.notebook.run import Run
from ispom.notebook.stepper import Stepper
from ispom.types import Step, TrackStatus

from ...presentation import colours
from .shown_frames import Message, ShownFrames, computed_frames, frame_message, stored_frames

STATIC = Path(__file__).parent / "static"
SAMPLES = 8
"""Frames by which the size of all is estimated."""
MOST_TRUE = 2000
"""Most positions of the true path that are drawn: a cell is about as many pixels wide."""
HEIGHT_PX = 560
"""Height of the page until it has reported its own."""
UNKNOWN = "A stored run keeps no single tracks: run it here with ispom.run to choose some."


def show(run: Any, frame: int | None, max_mb: float) -> View:
    """A view of a Run, a StoredRun or a Stepper, which begins at a frame. InputError where that has no step."""
    if isinstance(max_mb, bool) or not isinstance(max_mb, (int, float)) or not max_mb > 0:
        raise InputError(f"max_mb is {str(max_mb)[:40]!r}: give a size in MB above 0")
    if isinstance(run, Stepper):
        return View(_head(run.method, run.sequence.name, "the path as given then"), max_mb, rig=run.sequence.rig)
    frames = computed_frames(run) if isinstance(run, Run) else stored_frames(run)
    place = _place(run, frames.numbers, frame)
    found = chosen(frames, place, max_mb * 1e6)
    return View(_head_of(run, frames.numbers, len(found), max_mb), max_mb, found, frames.numbers[place])


def chosen(frames: ShownFrames, place: int, most_bytes: float) -> dict[int, str]:
    """By number, the message of each frame as JSON: of all, or of every n-th around this place so that they fit. The
    one at this place is there in any case."""
    count = len(frames.numbers)
    sample = np.unique(np.linspace(0, count - 1, SAMPLES).astype(int)).tolist()
    mean_bytes = sum(len(_json(frames.message(i))) for i in sample) / len(sample)
    every = max(1, math.ceil(count * mean_bytes / most_bytes))
    found = {i: _json(frames.message(i)) for i in range(place % every, count, every)}
    while len(found) > 1 and sum(map(len, found.values())) > most_bytes:
        every *= 2
        found = {i: text for i, text in found.items() if (i - place) % every == 0}
    return {frames.numbers[i]: text for i, text in found.items()}


class View(AnyWidget):
    """What is shown in a cell. `frame` is the number of the frame in it, `tracks` the ids of the chosen tracks.

    Both follow what a person does there, and may be set. `html` is the page, for a file of its own.
    """

    _esm = (STATIC / "link.js").read_text(encoding="utf-8")
    frame = traitlets.Int(None, allow_none=True).tag(sync=True)
    tracks = traitlets.List(traitlets.Int()).tag(sync=True)
    channel = traitlets.Unicode().tag(sync=True)
    page = traitlets.Unicode().tag(sync=True)

    def __init__(
        self,
        head: Message,
        max_mb: float,
        frames: dict[int, str] | None = None,
        frame: int | None = None,
        rig: Any = None,
    ) -> None:
        """`head`: what holds for all frames; `frames`: by number, their messages as JSON; `rig` of steps to come."""
        self._head, self._frames, self._most_bytes, self._rig = head, dict(frames or {}), max_mb * 1e6, rig
        self._path: dict[int, list[float]] = {}
        super().__init__(frame=frame, tracks=[], channel=f"ispom-{uuid4().hex}")
        if _in_marimo():
            self.page = self.html
        self.on_msg(lambda _, content, __: self._heard(content))

    @property
    def html(self) -> str:
        """The page with the frames that it has now: a whole HTML document that needs nothing else."""
        head = self._head | {"channel": self.channel, "start": self.frame, "tracks": self.tracks}
        if self._path:
            head["path"] = _columns([[number, *place] for number, place in self._path.items()])
        text = f'{json.dumps(head)[:-1]}, "frames": [{", ".join(self._frames.values())}]}}'
        parts = {"style": "view.css", "script": "view.js"}
        found = (STATIC / "view.html").read_text(encoding="utf-8")
        for mark, name in parts.items():
            found = found.replace(f"/* {mark} */", (STATIC / name).read_text(encoding="utf-8"))
        return found.replace("/* data */", text.replace("<", "\\u003c"))

    def add(self, number: int, step: Step, measurement: Any) -> None:
        """Takes in the next step and shows it; the oldest ones go where there is no room."""
        self._frames[number] = _json(frame_message(number, measurement, step, self._rig))
        place = None if step.world_from_frame is None else _numbers(step.world_from_frame.translation[[0, 2]])
        if place is not None:
            self._path[number] = place
        dropped = list[int]()
        while len(self._frames) > 1 and sum(map(len, self._frames.values())) > self._most_bytes:
            dropped.append(next(iter(self._frames)))
            del self._frames[dropped[-1]]
        self.send({"added": self._added(number), "dropped": dropped})
        self.frame = number

    def drop(self, end: int) -> None:
        """Takes out the frames from this number on."""
        gone = [number for number in {*self._frames, *self._path} if number >= end]
        for number in gone:
            self._frames.pop(number, None)
            self._path.pop(number, None)
        self.send({"dropped": gone, "untold": gone})
        self.frame = max(self._frames, default=None)

    @traitlets.validate("frame")
    def _known(self, proposal: Any) -> int | None:
        number = proposal["value"]
        if number is None or number in self._frames:
            return number
        if not self._frames:
            raise InputError(f"there is no frame {number} in this view: it has none yet")
        nearest = min(self._frames, key=lambda other: abs(other - number))
        raise InputError(f"there is no frame {number} in this view: the nearest is {nearest}")

    def _added(self, number: int) -> Message:
        return {"frame": json.loads(self._frames[number]), "place": self._path.get(number)}

    def _heard(self, content: Any) -> None:
        """A page that began says which frames it has: it gets those that came since."""
        known = content.get("known") if isinstance(content, dict) else None
        if not isinstance(known, list):
            return
        for number in self._frames:
            if number not in known:
                self.send({"added": self._added(number), "dropped": []})

    def __repr__(self) -> str:
        return f"View({self._head['label']} of {self._head['source']}: {len(self._frames)} frames, at {self.frame})"

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{escape(self.html)}" title="{escape(repr(self))}" '
            f'style="width: 100%; height: {HEIGHT_PX}px; border: 0"></iframe>'
        )

    def _ipython_display_(self, **_: Any) -> None:
        """The page, and below it the link: what shows widgets only with a network still shows the page."""
        from IPython.display import display

        display({"text/html": self._repr_html_(), "text/plain": repr(self)}, raw=True)
        bundle, about = self._repr_mimebundle_() or ({}, {})
        display({**bundle, "text/plain": ""}, metadata=about, raw=True)


def _place(run: Result, numbers: tuple[int, ...], frame: int | None) -> int:
    if not numbers:
        raise InputError(f"{run.method} has no step in {run.source}: there is nothing to show")
    if frame is None:
        return len(numbers) - 1
    if isinstance(frame, bool) or not isinstance(frame, (int, np.integer)):
        raise InputError(f"frame is {str(frame)[:40]!r}: give the number of a frame, from 0")
    if frame not in numbers:
        nearest = min(numbers, key=lambda number: abs(number - frame))
        raise InputError(f"{run.method} has no step at frame {frame}: the nearest is at frame {nearest}")
    return numbers.index(int(frame))


def _head(method: str, source: str, about_path: str) -> Message:
    return {
        "label": colours.label(method),
        "colour": colours.css(colours.of(method)),
        "source": source,
        "statuses": [[status.reason, colours.css(colours.TRACK[status])] for status in TrackStatus],
        "truthColour": colours.css(colours.TRUTH),
        "aboutPath": about_path,
        "unit": "m" if registered(method).unit == "metric" else "own unit",
        "path": [[], [], []],
        "truth": None,
        "unknown": "",
        "note": "",
    }


def _head_of(run: Result, numbers: tuple[int, ...], kept: int, max_mb: float) -> Message:
    """The path as known at the end, by the numbers of the frames, and the true one."""
    path, truth, unit = run.beside_truth()
    at = {int(time_ns): i for i, time_ns in enumerate(run.trajectory.times_ns)}
    rows = [
        [number, *_numbers(path[at[step.time_ns], [0, 2]])]
        for number, step in zip(numbers, run.steps, strict=True)
        if step.time_ns in at
    ]
    found = _head(run.method, run.source, "the path as known at the end") | {"unit": unit, "path": _columns(rows)}
    if truth is not None:
        found["truth"] = _columns([_numbers(place) for place in truth[:: -(-len(truth) // MOST_TRUE), [0, 2]]])
    if isinstance(run, StoredRun):
        found["unknown"] = UNKNOWN
    if kept < len(numbers):
        found["note"] = (
            f"{kept} of {len(numbers)} frames are in this view: more have room with max_mb above {max_mb:g}."
        )
    return found


def _columns(rows: list[list[float]]) -> list[list[float]]:
    return [list(column) for column in zip(*rows, strict=True)] if rows else [[], [], []]


def _numbers(values: Any) -> list[float]:
    """As Python's, with the digits that a picture can show."""
    return [float(f"{value:.6g}") for value in values]


def _json(message: Message) -> str:
    return json.dumps(message, separators=(",", ":"))


def _in_marimo() -> bool:
    """Whether the notebook is one of marimo's."""
    marimo = sys.modules.get("marimo")
    return marimo is not None and bool(marimo.running_in_notebook())
