"""The answer in words: what moved the pose most."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ispom.solvers.influence.blame import Influence

from ...presentation import colours
from ...presentation.texts import Unit, digits, length, length_unit
from .found import PoseBlame

COUNTS = 0.01
"""What moved the pose less than this share of the largest part is not worth a sentence."""


def answer(of: PoseBlame) -> list[str]:
    """Sentences, the answer first."""
    found, unit = of.found, unit_of(of)
    known = [each for each in found.influences if np.isfinite(each.shift.size)]
    tracks = next((each for each in known if each.part.kind in ("group", "track")), None)
    others = next((each for each in known if each.part.kind in ("frame", "prior", "sensor")), None)
    of_others = "more than anything else" + (" that is no track" if tracks is not None else "")
    said = []
    for each in filter(None, (tracks, others)):
        name = of.called(each)
        subject = name[:1].upper() + name[1:] if not name.startswith("IMU") else name
        beyond = "more than any other tracks" if each is tracks else of_others
        said.append(f"{subject} moved this pose by {moved(of, each, unit)}, {beyond}.")
    if not said:
        return ["Nothing that can be left out moved this pose."]
    if of.solver:
        said.append(f"This pose is that of {colours.label(of.solver)}, and was found there.")
    if of.by_known_points:
        said.append("Frame by frame the pose follows from points of the map, which are taken as known here.")
    largest = max((each.shift.size for each in known), default=0.0)
    if of.changed_since > COUNTS * largest:
        beyond = size(of, of.changed_since, unit)
        said.append(f"What the method did afterwards moved the pose by {beyond} more, and is not taken apart.")
    return said


def moved(of: PoseBlame, each: Influence, unit: Unit | None) -> str:
    """How far, and how the camera turned."""
    turn = float(np.degrees(np.linalg.norm(each.shift.rotation)))
    return f"{size(of, each.shift.size, unit)} and {digits(turn)}°"


def size(of: PoseBlame, value: float, unit: Unit | None) -> str:
    """A length of the method's world, in metres where its unit is known."""
    if of.unit_m is None:
        return f"{digits(value)} units"
    return length(value * of.unit_m, unit)


def unit_of(of: PoseBlame) -> Unit | None:
    """The unit that the lengths shown share."""
    return None if of.unit_m is None else length_unit(_metres(of, of.listed()))


def _metres(of: PoseBlame, some: Iterable[Influence]) -> list[float]:
    return [each.shift.size * (of.unit_m or 1.0) for each in some]
