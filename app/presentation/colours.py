"""One colour per meaning, everywhere: 3-D, images, plots, lamps and report.

From Okabe and Ito's colour-blind safe set (Color Universal Design, 2008). The methods' colours and the truth's grey
have a contrast of at least 3 on white and on Rerun's near-black, so that they read in both themes. Amber is a warning's
alone: no method and no branch is near it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.methods import method as registered
from ispom.methods import names
from ispom.types import TrackStatus

Rgb = tuple[int, int, int]

METHOD: dict[str, Rgb] = {
    "monocular": (213, 94, 0),  # vermilion
    "stereo": (0, 114, 178),  # blue
    "integrated": (0, 158, 115),  # bluish green
    "monocular.paper": (198, 118, 126),  # dusty rose
    "stereo.paper": (106, 120, 205),  # periwinkle
    "integrated.paper": (179, 96, 146),  # reddish purple, a little darker
}
OTHERS: tuple[Rgb, ...] = (
    (150, 90, 210),
    (110, 130, 50),
    (0, 140, 150),
    (190, 70, 80),
    (200, 80, 190),
    (140, 105, 85),
    (60, 135, 70),
    (80, 125, 160),
    (126, 30, 246),
    (246, 30, 246),
    (246, 30, 138),
    (246, 30, 54),
    (30, 162, 30),
    (30, 78, 234),
    (210, 126, 90),
    (162, 30, 198),
    (162, 138, 186),
    (78, 102, 66),
)
"""Of methods of other packages, then of those of the survey, in turn; with more of them than these, some share one.
Each is at least 18 from all others in Lab (CIE 1976)."""
EXTERNAL_COLOURS: tuple[Rgb, ...] = ((214, 39, 90), (95, 115, 150), (150, 85, 60), (95, 140, 20))
"""Of trajectories of other programs, in turn."""
PROVISIONAL: Rgb = (150, 150, 150)
"""Of a camera whose pose is not metric yet."""
TRUTH: Rgb = (138, 138, 138)
ERROR: Rgb = (229, 57, 53)
"""Of the line from an estimate to the ground truth."""
DISPARITY: Rgb = (240, 228, 66)
TRAIL: Rgb = (86, 180, 233)
MOVING: Rgb = (255, 20, 147)
"""What one other rigid motion than the camera's explains."""
UNUSED: Rgb = (120, 120, 120)
"""Of lines that a method found and does not use."""
GROUPS: tuple[Rgb, ...] = ((230, 80, 60), (0, 158, 115), (60, 130, 230), (230, 159, 0), (204, 121, 167), (0, 170, 180))
"""Of groups of lines, in turn: the first three are those of axes."""

STAGES: tuple[Rgb, ...] = (
    (86, 180, 233),
    (230, 159, 0),
    (0, 158, 115),
    (204, 121, 167),
    (148, 138, 40),
    (213, 94, 0),
    (138, 138, 138),
    (0, 114, 178),
)
"""Of the stages of a step, in turn."""

_GEOMETRY, _SEARCH = (213, 94, 0), (204, 121, 167)
TRACK: dict[TrackStatus, Rgb] = {
    TrackStatus.ALIVE: (86, 180, 233),  # sky blue
    TrackStatus.NEW: (0, 158, 115),  # bluish green
    TrackStatus.LOST: _SEARCH,
    TrackStatus.FORWARD_BACKWARD: _SEARCH,
    TrackStatus.UNMATCHED: _SEARCH,
    TrackStatus.EPIPOLAR: _GEOMETRY,
    TrackStatus.REPROJECTION: _GEOMETRY,
    TrackStatus.RIGID: _GEOMETRY,
    TrackStatus.OUT_OF_IMAGE: (160, 160, 160),
    TrackStatus.NO_DISPARITY: (230, 159, 0),  # orange
}


def of(method: str) -> Rgb:
    """The colour of a method."""
    if method in METHOD:
        return METHOD[method]
    others = sorted((n for n in names() if n not in METHOD), key=lambda n: bool(registered(n).survey))
    return OTHERS[others.index(method) % len(OTHERS)] if method in others else OTHERS[0]


def colour_of_external(number: int) -> Rgb:
    """The colour of the trajectory of another program, by its place among those given."""
    return EXTERNAL_COLOURS[number % len(EXTERNAL_COLOURS)]


def of_groups(group: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Returns (N, 3) the colours of groups (N,): -1 for lines that are not used."""
    table = np.array((*GROUPS, UNUSED), np.uint8)
    return table[np.where(group < 0, len(GROUPS), group % len(GROUPS))]


def label(method: str) -> str:
    """A method's name for people: "Lines (monocular)" of lines.monocular, "Monocular, 2013" of monocular.paper."""
    base, _, kind = method.partition(".")
    text = base[:1].upper() + base[1:].replace("_", " ")
    if not kind:
        return text
    return f"{text}, {variant(method)}" if kind == "paper" else f"{text} ({variant(method)})"


def variant(method: str) -> str:
    """What distinguishes it from the method of the same base name; "2013" of one as it was published then."""
    kind = method.partition(".")[2]
    return "2013" if kind == "paper" else kind.replace("_", " ")


def stage(index: int) -> Rgb:
    return STAGES[index % len(STAGES)]


def shade(colour: Rgb, towards: Rgb, fraction: float) -> Rgb:
    """The colour mixed with another: fraction 0 keeps it, 1 gives the other."""
    r, g, b = (round(a + (t - a) * fraction) for a, t in zip(colour, towards, strict=True))
    return r, g, b


def packed(colour: Rgb) -> list[int]:
    """One colour for all of an entity, as Rerun takes it fastest."""
    r, g, b = colour
    return [r << 24 | g << 16 | b << 8 | 255]


def css(colour: Rgb) -> str:
    """As a web page writes it: #d55e00."""
    return "#{:02x}{:02x}{:02x}".format(*colour)
