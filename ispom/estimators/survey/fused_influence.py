"""What moved the newest node of `fused`: the window is solved again without the factors of one sensor.

What the sensor said before the window is in its prior, and stays there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.survey.fused_factors import DIMENSIONS
from ispom.estimators.survey.fused_start import OPTICAL_FROM_LEVEL
from ispom.estimators.survey.fused_values import Node, Prior
from ispom.geometry import Array, Pose
from ispom.numerics.twist import twist_of
from ispom.solvers.influence.problem import Part, Shift
from ispom.types import FrameName

if TYPE_CHECKING:
    from ispom.estimators.survey.fused_graph import Graph

NAMES = {"visual": "images", "imu": "IMU", "gnss": "GNSS", "wheel": "wheels", "laser": "laser"}
"""Of the sensors, by the names of their factors."""


@dataclass(frozen=True, eq=False)
class GraphProblem:
    """A window of nodes that was optimised."""

    graph: Graph
    start: tuple[Node, ...]
    """Before."""
    solved: tuple[Node, ...]
    """After."""
    prior: Prior

    @property
    def frame(self) -> FrameName:
        return "rig"

    @property
    def pose(self) -> Pose:
        return _newest(self.solved)

    @property
    def parts(self) -> tuple[Part, ...]:
        told = {factor.sensor for factor in self.graph.factors(self.start, self.prior)}
        return tuple(Part("sensor", name) for sensor, name in NAMES.items() if sensor in told & set(DIMENSIONS))

    def shifts(self, parts: tuple[Part, ...]) -> list[Shift]:
        return [self._without(part, self.solved) for part in parts]

    def really(self, part: Part) -> Shift:
        return self._without(part, self.start)

    def seen(self) -> tuple[NDArray[np.int64], Array]:
        return np.zeros(0, np.int64), np.zeros((0, 2))

    def _without(self, part: Part, start: tuple[Node, ...]) -> Shift:
        sensor = next(s for s, name in NAMES.items() if name == part.name)
        try:
            before, after = (
                _newest(self.graph.solved(self.start, self.prior, start, without)[0]) for without in (sensor, "")
            )
        except RuntimeError:  # of gtsam, where the rest does not determine the nodes
            return Shift.unknown()
        return Shift(after.translation - before.translation, twist_of(after.inverse() @ before)[3:])


def _newest(nodes: tuple[Node, ...]) -> Pose:
    return Pose(OPTICAL_FROM_LEVEL) @ nodes[-1].local_from_rig
