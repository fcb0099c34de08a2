"""The paths of one method in two runs: where they part, how far they are apart, and a map of that place."""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from ispom.evaluation.trajectory_error import TrajectoryError
from ispom.geometry import Array
from ispom.methods import method as registered
from ispom.solvers.trajectory.alignment import umeyama

from ...engine.differences.paths import FIRST_STEPS, Parting, Path, distances, in_one_world, parting, path_length
from ...presentation import colours
from ...presentation.texts import length

MOST_POINTS = 600
"""Most points of a curve; with more frames each point is the largest of several."""
AROUND = 20
"""Frames before and after the parting whose paths are drawn."""


class Place(msgspec.Struct, frozen=True):
    """Where the paths of a method part."""

    method: str
    label: str
    frame: int
    at_once: bool
    """By a jump, not by drift."""
    sentence: str
    paths: dict[str, list[tuple[float, float]]]
    """Of A, B and, where it is known, the truth: positions around that frame in the plane in which A moves most [m, or
    the unit of A]."""
    here: dict[str, tuple[float, float]]
    """The positions of A and B at that frame."""


class Curve(msgspec.Struct, frozen=True):
    """The distance between A and B of one method."""

    method: str
    label: str
    colour: str
    metres: bool
    """Whether the values are; else they are in the unit of A."""
    how: str
    frames: list[int]
    values: list[float]
    parts_at: int | None
    """The frame at which the paths part."""


@dataclass(frozen=True, eq=False)
class Placed:
    """Both paths in one world."""

    a: Path
    b: Path
    metres: bool
    parting: Parting | None


class ComparedPaths:
    """Both are of one method, each as its poses were given at their frames."""

    def __init__(
        self, method: str, a: Path, b: Path, error: TrajectoryError | None, times_ns: NDArray[np.int64]
    ) -> None:
        """`error` is A's against the ground truth; `times_ns` (N,) are the times of the frames."""
        self.method, self.label, self.times_ns = method, colours.label(method), times_ns
        self._error = error
        self.placed = self._placed(a, b)

    def _placed(self, a: Path, b: Path) -> Placed | None:
        """Both paths in one world and unit; None where they share too few poses."""
        if registered(self.method).unit == "metric":
            return Placed(a, b, True, parting(a, b))
        found = in_one_world(a, b)
        if found is None:
            return None
        factor = self._metres_per_unit(a, b)
        a, b = (path.scaled(factor or 1.0) for path in found)
        return Placed(a, b, factor is not None, parting(a, b))

    def _metres_per_unit(self, a: Path, b: Path) -> float | None:
        """By the truth of the first steps; None without one."""
        if self._error is None:
            return None
        truth = self._truth(np.intersect1d(a.frames, b.frames)[: FIRST_STEPS + 1])
        own = path_length(a.at(truth.frames).xyz)
        return path_length(truth.xyz) / own if own else None

    def _truth(self, frames: NDArray[np.int64]) -> Path:
        """The true positions at these frames, where they are known."""
        error = self._error
        if error is None:
            return Path(frames[:0], np.zeros((0, 3)), np.zeros((0, 4)))
        frames = frames[np.isin(self.times_ns[frames], error.estimate.times_ns)]
        places = np.searchsorted(error.estimate.times_ns, self.times_ns[frames])
        return Path(frames, error.reference.translations[places], np.zeros((len(frames), 4)))

    def curve(self) -> Curve | None:
        placed = self.placed
        if placed is None:
            return None
        frames, values = distances(placed.a, placed.b)
        if not len(frames):
            return None
        starts = np.arange(0, len(frames), -(-len(frames) // MOST_POINTS))
        how = "positions as given at the frame"
        if registered(self.method).unit != "metric":
            how += ", first poses and the scale of the first steps brought together"
        return Curve(
            self.method,
            self.label,
            colours.css(colours.of(self.method)),
            placed.metres,
            how,
            frames[starts].tolist(),
            [float(f"{value:.6g}") for value in np.maximum.reduceat(values, starts).tolist()],
            None if placed.parting is None else placed.parting.frame,
        )

    def place(self) -> Place | None:
        placed = self.placed
        if placed is None or placed.parting is None:
            return None
        found = placed.parting
        apart = length(found.distance) if placed.metres else f"{found.distance:.3g} of A's units"
        sentence = f"At frame {found.frame} the paths of {self.label} jump apart: {apart}."
        if not found.at_once:
            sentence = f"The paths of {self.label} drift apart from frame {found.frame} on: {apart} there."
        near = [_near(path, found.frame) for path in (placed.a, placed.b)]
        frames = np.arange(max(found.frame - AROUND, 0), min(found.frame + AROUND + 1, len(self.times_ns)))
        truth = self._truth(frames) if placed.metres else self._truth(frames[:0])
        drawn = {"A": near[0].xyz, "B": near[1].xyz}
        if (moved := _moved_to(truth, near[0])) is not None:
            drawn["truth"] = moved
        plane = _plane(near[0].xyz)
        flat = {name: [(float(x), float(y)) for x, y in (xyz @ plane).round(6).tolist()] for name, xyz in drawn.items()}
        here = {}
        for name, path in zip("AB", near, strict=True):
            x, y = (path.at(np.array([found.frame])).xyz[0] @ plane).tolist()
            here[name] = (float(x), float(y))
        return Place(self.method, self.label, found.frame, found.at_once, sentence, flat, here)


def _near(path: Path, frame: int) -> Path:
    near = abs(path.frames - frame) <= AROUND
    return Path(path.frames[near], path.xyz[near], path.xyzw[near])


def _moved_to(truth: Path, a: Path) -> Array | None:
    """The true positions, rotated and moved to where A begins; None with too few."""
    common = np.intersect1d(truth.frames, a.frames)
    if len(common) < FIRST_STEPS:
        return None
    return umeyama(truth.at(common).xyz, a.at(common).xyz, with_scale=False).apply(truth.xyz)


def _plane(xyz: Array) -> Array:
    """(3, 2) the two directions in which positions (N, 3) vary most, right-handed and with a fixed sign."""
    axes = np.linalg.svd(xyz - xyz.mean(axis=0), full_matrices=True)[2][:2]
    signs = [math.copysign(1.0, float(axis[np.argmax(abs(axis))])) for axis in axes]
    return (axes * np.array(signs)[:, None]).T
