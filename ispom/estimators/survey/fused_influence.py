"""The influence of each sensor on the newest node of `fused`: the window is solved again without its factors.

Measurements of the sensor before the window are in the prior, and stay there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.survey.fused_graph import Graph
from ispom.estimators.survey.fused_start import OPTICAL_FROM_LEVEL
from ispom.estimators.survey.fused_values import Prior
from ispom.geometry import Array, Pose
from ispom.numerics.twist import twist_of
from ispom.sensors.fusion import Node
from ispom.solvers.influence.problem import Part, Shift
from ispom.types import FrameName


@dataclass(frozen=True, eq=False)
class GraphProblem:
    """A window of nodes that was optimised."""

    graph: Graph
    start: tuple[Node, ...]
    """The nodes before they are solved."""
    solved: tuple[Node, ...]
    """The nodes after they are solved."""
    prior: Prior

    @property
    def frame(self) -> FrameName:
        return "rig"

    @property
    def pose(self) -> Pose:
        return _newest(self.solved)

    @property
    def _names(self) -> dict[str, str]:
        """Returns the names of the sensors by the names of their factors."""
        return {"visual": "images", **{kind.name: kind.word for kind in self.graph.kinds}}

    @property
    def parts(self) -> tuple[Part, ...]:
        measured = {f.sensor for f in self.graph.factors(self.start, self.prior) if f.dimensions}
        return tuple(Part("sensor", name) for sensor, name in self._names.items() if sensor in measured)

    def shifts(self, parts: tuple[Part, ...]) -> list[Shift]:
        return [self._without(part, self.solved) for part in parts]

    def really(self, part: Part) -> Shift:
        return self._without(part, self.start)

    def seen(self) -> tuple[NDArray[np.int64], Array]:
        return np.zeros(0, np.int64), np.zeros((0, 2))

    def _without(self, part: Part, start: tuple[Node, ...]) -> Shift:
        sensor = next(sensor for sensor, name in self._names.items() if name == part.name)
        try:
            before, after = (
                _newest(self.graph.solved(self.start, self.prior, start, without).nodes) for without in (sensor, "")
            )
        except RuntimeError:  # of gtsam, where the rest does not determine the nodes
            return Shift.unknown()
        return Shift(after.translation - before.translation, twist_of(after.inverse() @ before)[3:])


def _newest(nodes: tuple[Node, ...]) -> Pose:
    return Pose(OPTICAL_FROM_LEVEL) @ nodes[-1].local_from_rig
