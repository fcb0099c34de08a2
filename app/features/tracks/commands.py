"""Selecting tracks and keyframes, and choosing what is shown of them."""

from __future__ import annotations

from dataclasses import replace

from ...session.commands import Command, PageCommand
from ...session.controller import Controller
from ...session.registry import handles
from .selecting import picked, selected
from .state import Inspection, Panel


class Select(PageCommand, frozen=True):
    """Look closely at a track or a keyframe, as engine/inspection/selection.py writes it; empty for nothing."""

    what: str


class Pick(PageCommand, frozen=True):
    """Select the track that is nearest to a pixel of a camera's image at a frame."""

    camera: str
    index: int
    u: float
    v: float


class LookAt(Command, frozen=True):
    """What the tab shows: the image of a camera, and one of its panels; None leaves either unchanged."""

    panel: Panel | None = None
    camera: str | None = None


@handles(Select)
def select(session: Controller, command: Select) -> None:
    session.store.put(replace(session.state[Inspection], selected=selected(command.what)))


@handles(Pick)
def pick(session: Controller, command: Pick) -> None:
    at = command.camera, command.index, command.u, command.v
    session.store.put(replace(session.state[Inspection], selected=picked(session.run, *at)))


@handles(LookAt)
def look_at(session: Controller, command: LookAt) -> None:
    before = session.state[Inspection]
    camera = before.camera if command.camera is None else command.camera
    session.store.put(replace(before, panel=command.panel or before.panel, camera=camera))
