"""The legend at the image: what the colours of its tracks mean, and of each state how many tracks have it."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import numpy as np

from ispom.types import TrackStatus

from ...engine.history.record import ExposureRecord
from ...engine.inspection.colouring import SCALES, palette
from ...engine.inspection.sightings import seen_by
from ...presentation import colours
from ...session.current_run import CurrentRun
from ...session.state import State
from ...views.rerun.entities import status_text
from ...views.web.view_values import View
from .state import Layers


class LegendItem(msgspec.Struct, frozen=True):
    """A colour, and what it means; colours between two that are named have no text."""

    colour: str
    text: str


class LegendView(msgspec.Struct, frozen=True):
    """The items in the order of their row; none where no tracks are drawn."""

    title: str
    items: tuple[LegendItem, ...]


def legend(state: State, run: CurrentRun | None, frame: int) -> LegendView:
    layers = state[Layers]
    if run is None or state.displayed is None or "tracks" in layers.undrawn:
        return LegendView("", ())
    if layers.colour_by == "state":
        return LegendView("Tracks", tuple(_states(state.displayed)))
    scale = SCALES[layers.colour_by]
    named = [text if i in (0, len(palette()) - 2, len(palette()) - 1) else "" for i, text in enumerate(scale.labels())]
    items = (LegendItem(colours.css(rgb), text) for rgb, text in zip(palette(), named, strict=True))
    return LegendView(scale.title, tuple(items))


def _states(record: ExposureRecord) -> Iterator[LegendItem]:
    """With their counts; of a frame whose single tracks are not known, the states that there are."""
    seen = seen_by(record)
    if seen is None:
        names: dict[str, list[str]] = {}
        for status, rgb in colours.TRACK.items():
            names.setdefault(colours.css(rgb), []).append(status_text(status))
        yield from (LegendItem(colour, " / ".join(texts)) for colour, texts in names.items())
        return
    counts = np.bincount(seen.tracks.status, minlength=len(TrackStatus))
    for status in TrackStatus:
        if counts[status]:
            yield LegendItem(colours.css(colours.TRACK[status]), f"{counts[status]} {status_text(status)}")
    if seen.moved is not None:
        yield LegendItem(colours.css(colours.MOVING), f"{len(seen.moved)} move alone")


VIEWS = (View("legend", "#legend", 5, legend),)
