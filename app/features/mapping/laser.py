"""A laser's points placed by the poses of each method; where the place is a simulated one, how far off they are."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.evaluation.association import associate
from ispom.geometry import Array, Pose
from ispom.io.files import expanded
from ispom.io.timed_points import read_timed_points
from ispom.reconstruction.model import Surface
from ispom.reconstruction.registration import Registered, registered, world_from_own
from ispom.sequences.formats.simulated import rendered_source
from ispom.simulation.laser import Profiler
from ispom.simulation.motions import motion_of
from ispom.solvers.trajectory.continuous import Between
from ispom.types import TimedPoints, Trajectory

from .inputs import Ran
from .options import SIMULATED

TRUE = "truth"
"""What the poses of the simulation itself give: the noise of the ranges alone."""


@dataclass(frozen=True, eq=False)
class Placed:
    """The points as one method places them."""

    points: Registered
    """In the method's own world."""
    poses_hz: float
    distances_m: NDArray[np.float32] | None = None
    """(N,) from the surfaces of the simulated place, after the path was laid on the true one; None for a real one."""
    true_world: Array | None = None
    """(N, 3) the points there."""

    @property
    def numbers(self) -> dict[str, Any]:
        found: dict[str, Any] = {"points": len(self.points), "poses_hz": round(self.poses_hz, 3)}
        if self.distances_m is not None and len(self.distances_m):
            far = self.distances_m
            quantiles = {"median_m": 50, "p95_m": 95}
            found |= {"rmse_m": float(np.sqrt(np.mean(np.square(far, dtype=float))))}
            found |= {name: float(np.percentile(far, at)) for name, at in quantiles.items()}
        return found


@dataclass(frozen=True, eq=False)
class Measured:
    """What the laser said."""

    points: TimedPoints
    rig_from_laser: Pose
    surface: Surface | None
    """Of the simulated place."""
    unmeasured: str = ""
    """Why nothing measures distances to the simulated place, one sentence."""


def measured(ran: Ran, laser: str, seed: int) -> Measured:
    """The points of a file, or those of the profiler in a simulation. InputError where there are none, or nothing says
    where the laser is on the rig."""
    simulated = rendered_source(ran.file.source, seed)
    surface, unmeasured = None, ""
    if simulated is not None:
        try:
            surface = Surface(simulated.scene.triangles)
        except InputError as error:  # without Open3D the points are placed all the same
            unmeasured = f"distances from the simulated place are not measured: {error}"
    if laser == SIMULATED:
        if simulated is None:
            raise InputError(f"{ran.file.source} is no simulation: give --laser as a file of the laser's points")
        motion = motion_of(simulated.motion, simulated.seed)
        start_ns, end_ns = int(ran.sequence.times_ns[0]), int(ran.sequence.times_ns[-1])
        found = Profiler().scan(simulated.scene, motion.pose_at, start_ns, end_ns, simulated.seed)
        return Measured(found, Profiler().rig_from_laser, surface, unmeasured)
    points = read_timed_points(expanded(laser))
    placed = ran.sequence.rig.rig_from_laser
    if placed is None and simulated is None:
        raise InputError(
            "nothing says where the laser is: add laser: {rig_from_laser: {translation_m: [x, y, z], "
            "rotation_xyzw: [0, 0, 0, 1]}} to the rig.yaml of the recording"
        )
    return Measured(points, placed or Profiler().rig_from_laser, surface, unmeasured)


def placed(ran: Ran, of: Measured, between: Between, advance: Callable[[], None]) -> Mapping[str, Placed]:
    """By metric method, and by TRUE where the place is simulated. InputError where no time of a point has poses."""
    paths = dict(ran.paths)
    truth = ran.sequence.truth if of.surface is not None else None
    if truth is not None:
        paths[TRUE] = truth
    found = {}
    for name, path in paths.items():
        points = registered(of.points, path, of.rig_from_laser, between)
        rate = (len(path) - 1) / ((int(path.times_ns[-1]) - int(path.times_ns[0])) * 1e-9)
        found[name] = Placed(points, rate, *_errors(points, path, truth, of.surface))
        advance()
    if not any(len(each.points) for each in found.values()):
        raise InputError(
            "no point of the laser was measured while the run had poses: give its times on the clock of the exposures"
        )
    return found


def _errors(
    points: Registered, path: Trajectory, truth: Trajectory | None, surface: Surface | None
) -> tuple[NDArray[np.float32], Array] | tuple[()]:
    if truth is None or surface is None:
        return ()
    own, true = associate(path, truth)
    in_truth = world_from_own(own, true).apply(points.xyz_in_world)
    return surface.distances(in_truth), in_truth
