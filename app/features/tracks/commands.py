"""What is looked at closely: selecting tracks and keyframes, and choosing what is shown of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from ispom.errors import InputError

from ...engine.inspection.selection import Selection, parsed
from ...engine.inspection.sightings import missing_tracks, nearest, seen_by
from ...session.commands import Command, PageCommand
from ...session.controller import Controller
from ...session.current_run import CurrentRun
from ...session.state import FeatureState, Opening, State


def selected(what: str) -> str:
    """As it is written; InputError where that says nothing that could be selected."""
    return str(parsed(what) or "")


def picked(run: CurrentRun | None, camera: str, index: int, u: float, v: float) -> str:
    """The track nearest to a pixel of a camera's image. InputError if the frame has no tracks of that camera."""
    seen = None
    if run is not None and 0 <= index < len(run.history):
        record = run.history[index]
        seen = seen_by(record, camera=camera)
        unavailable = run.stored.unavailable if run.stored is not None else ""
        if (seen is None or not len(seen.tracks)) and (
            missing := missing_tracks(record, unavailable, run.is_recorded(index))
        ):
            raise InputError(missing)
    number = None if seen is None else nearest(seen, np.array([u, v]))
    if seen is None or number is None:
        raise InputError(f"frame {index} has no tracks of the {camera[:20]} camera: pick at another one")
    return str(Selection("track", seen.step.method, number))


PanelName = Literal["track", "tracks", "lifetimes", "keyframes", "residuals", "geometry"]


@dataclass(frozen=True)
class Inspection(FeatureState):
    selected: str = ""
    """As engine/inspection/selection.py writes it: `track:monocular:181`; empty for nothing."""
    camera: str = ""
    """Whose image is shown; empty for the first that the rig has."""
    panel: PanelName = "track"
    """What the tab shows below the image."""

    def reduce(self, event: object) -> Inspection:
        return replace(self, selected="", camera="") if isinstance(event, Opening) else self

    def page(self, state: State) -> dict[str, Any]:
        return {"selected": self.selected, "camera": self.camera, "look": self.panel}


class Select(PageCommand, frozen=True):
    """Look closely at a track or a keyframe, as engine/inspection/selection.py writes it; empty for nothing."""

    what: str

    def execute(self, session: Controller) -> None:
        session.store.put(replace(session.state[Inspection], selected=selected(self.what)))


class Pick(PageCommand, frozen=True):
    """Select the track that is nearest to a pixel of a camera's image at a frame."""

    camera: str
    index: int
    u: float
    v: float

    def execute(self, session: Controller) -> None:
        at = self.camera, self.index, self.u, self.v
        session.store.put(replace(session.state[Inspection], selected=picked(session.run, *at)))


class LookAt(Command, frozen=True):
    """What the tab shows: the image of a camera, and one of its panels; None leaves either unchanged."""

    panel: PanelName | None = None
    camera: str | None = None

    def execute(self, session: Controller) -> None:
        before = session.state[Inspection]
        camera = before.camera if self.camera is None else self.camera
        session.store.put(replace(before, panel=self.panel or before.panel, camera=camera))
