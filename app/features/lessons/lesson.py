"""A lesson as a value: what its file says, read and checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import msgspec
import numpy as np
from numpy.typing import NDArray

from ispom.methods import Config
from ispom.types import Rig, Tracks, TrackStatus

from ...engine.conditions.evaluate import holds
from ...engine.conditions.parser import Expression
from ...engine.history.quantities import NO_ROW, finite
from ...engine.history.quantity import Quantity

TRACK: Mapping[str, Quantity] = {
    q.name: q
    for q in (
        Quantity("track", "disparity_px", "number", "left minus right column", "px"),
        Quantity("track", "depth_m", "number", "by its disparity", "m"),
        Quantity("track", "residual_px", "number", "reprojection error", "px"),
        Quantity("track", "moved_px", "number", "from the same camera's image before", "px"),
        Quantity("track", "dropped", "flag", "whether it ended here"),
        Quantity("track", "disagrees", "flag", "whether it ended because it does not fit the motion"),
    )
}
DISAGREES = (TrackStatus.EPIPOLAR, TrackStatus.REPROJECTION, TrackStatus.RIGID)


def right_tracks(tracks: Tracks, rig: Rig, condition: Expression) -> NDArray[np.bool_]:
    """(N,) for which of the tracks the condition holds."""
    columns = _columns(tracks, rig)
    rows = ({"track": {key: _value(column[i]) for key, column in columns.items()}} for i in range(len(tracks)))
    return np.array([holds(condition, row, NO_ROW) for row in rows], bool)


def _columns(tracks: Tracks, rig: Rig) -> dict[str, NDArray]:
    disparity_px = np.asarray(tracks.disparity_px, float)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth_m = rig.camera("left").fx * rig.baseline_m / disparity_px if rig.has_stereo else disparity_px * np.nan
    return {
        "disparity_px": disparity_px,
        "depth_m": depth_m,
        "residual_px": np.asarray(tracks.residual_px, float),
        "moved_px": np.linalg.norm(tracks.uv - tracks.uv_prev, axis=1),
        "dropped": tracks.status >= TrackStatus.LOST,
        "disagrees": np.isin(tracks.status, DISAGREES),
    }


def _value(cell: object) -> float | bool | None:
    return bool(cell) if isinstance(cell, np.bool_) else finite(float(cell))  # type: ignore[arg-type]


OWN = "this"
"""What a step calls its own run."""


@dataclass(frozen=True)
class RunRequest:
    """A run that a step needs."""

    source: str
    methods: tuple[str, ...]
    config: Config


@dataclass(frozen=True)
class Fact:
    """A number, or a curve, that a named function of `facts` finds in runs."""

    function: str
    run: str
    arguments: tuple[str, ...]


@dataclass(frozen=True)
class Option:
    """One of several answers."""

    text: str
    holds: Expression
    """Over the step's values: of all options, the one whose condition holds is right."""


@dataclass(frozen=True)
class Choose:
    options: tuple[Option, ...]


class Number(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    value: str
    """The name of the step's value that is the answer."""
    unit: str = ""
    within: float = 0.0
    """An answer this near is right."""
    within_percent: float = 0.0
    """Likewise, as a share of what is right."""

    def tolerance(self, true: float) -> float:
        """How far an answer may be from the true one."""
        return max(self.within, abs(true) * self.within_percent / 100)


@dataclass(frozen=True)
class Point:
    """A track in the picture of a camera."""

    camera: str
    right: Expression
    """Over `track.*`: which tracks are right."""


@dataclass(frozen=True)
class Draw:
    """A curve, from left to right."""

    curve: Fact
    x: str
    y: str
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    within: float
    """A drawn curve is right where it is this near on average."""


Ask = Choose | Number | Point | Draw


@dataclass(frozen=True)
class Step:
    title: str
    before: str
    """Markdown: what there is to see, and the question."""
    after: str
    """Markdown: what the run showed, `{value:.2f}` in the place of a value."""
    own: RunRequest
    ask: Ask
    at: int = 0
    """The frame up to which its run has come, and which is shown, when it asks."""
    to: int | None = None
    """The frame up to which all its runs go when it reveals; None for the last one."""
    hidden: frozenset[str] = frozenset()
    """Layers and methods that are not drawn until then."""
    tools: bool = False
    """Whether the panels can be used while it asks: only where the answer is to be found in them."""
    runs: Mapping[str, RunRequest] = field(default_factory=dict)
    """Further runs by name: branches next to its own when it reveals."""
    values: Mapping[str, Fact | Expression] = field(default_factory=dict)
    """By name, each from facts, or from the quantities and values before it."""
    claims: tuple[Expression, ...] = ()
    """What the text after it says, as conditions over the values."""


@dataclass(frozen=True)
class Lesson:
    name: str
    title: str
    minutes: int
    about: str
    """Markdown, before the first step."""
    steps: tuple[Step, ...]
