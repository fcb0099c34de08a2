"""A laser's points placed by the poses of each method; where the place is a simulated one, how far off they are."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.evaluation.trajectory_error import associate
from ispom.geometry import Array, Pose
from ispom.io.files import expanded
from ispom.io.timed_points import read_timed_points
from ispom.reconstruction.model import Surface
from ispom.reconstruction.registration import Registered, registered, world_from_own
from ispom.sensors.laser import Profiler
from ispom.sequences.formats.simulated import rendered_source
from ispom.simulation.motions import motion_of
from ispom.solvers.trajectory.continuous import Between
from ispom.types import TimedPoints, Trajectory

from ...presentation.colours import label
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
    """The laser's measurements."""

    points: TimedPoints
    rig_from_laser: Pose
    surface: Surface | None
    """Of the simulated place."""
    unmeasured: str = ""
    """Why nothing measures distances to the simulated place, one sentence."""


def measured(ran: Ran, laser: str, seed: int) -> Measured:
    """The points of a file, or those of the profiler in a simulation. InputError where there are none, or nothing says
    where the laser is on the rig."""
    if not ran.paths:
        raise InputError(
            f"{ran.folder} has no metric poses, by which a laser's points are placed: run stereo or integrated"
        )
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
            "no point of the laser was measured while the run had poses: give its times on the clock of the frames"
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


PANEL_IN = 4.4
LENGTH_M, DEPTH_M = 16.0, 14.0
"""Length of the stretch in the middle of the path that is shown, and its depth to the left."""
WORST_M = 0.3
"""Errors from here on have one colour."""


def picture(found: Mapping[str, Placed]) -> bytes:
    """PNG: seen from the side that the path has at its left; each point in the colour of its error.

    Takes Matplotlib, of the extra `plots`.
    """
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    shown = {name: each for name, each in found.items() if each.true_world is not None and len(each.points)}
    figure = Figure(figsize=(1 + PANEL_IN * len(shown), 5.2), layout="constrained")
    places = figure.subplots(1, len(shown), sharex=True, sharey=True, squeeze=False)[0]
    norm, colours = Normalize(0, 100 * WORST_M), colormaps["viridis"]
    middle = float(np.median(np.concatenate([each.true_world[:, 2] for each in shown.values()])))  # type: ignore[index]
    for axes, (name, each) in zip(places, shown.items(), strict=True):
        xyz, distances_m = each.true_world, each.distances_m
        if xyz is None or distances_m is None:
            raise ValueError(f"the points of {name} have no true places or no distances: compare them first")
        seen = (abs(xyz[:, 2] - middle) < LENGTH_M / 2) & (xyz[:, 0] < -2) & (xyz[:, 0] > -DEPTH_M) & (xyz[:, 1] < 0.1)
        axes.scatter(
            xyz[seen, 2], -xyz[seen, 1], c=100 * distances_m[seen], norm=norm, cmap=colours, s=0.4, linewidths=0
        )
        numbers = each.numbers
        who = "the true poses" if name == TRUE else f"{label(name)}, {each.poses_hz:.0f} poses/s"
        rms, median = (f"{100 * numbers[key]:.1f} cm" for key in ("rmse_m", "median_m"))
        axes.set_title(f"{who}\n{rms} from the true surfaces (RMS), median {median}", fontsize=9)
        axes.set(xlabel="along the street [m]", aspect="equal")
    places[0].set_ylabel("height [m]")
    figure.colorbar(ScalarMappable(norm, colours), ax=list(places), label="error [cm]", shrink=0.6)
    content = BytesIO()
    figure.savefig(content, format="png", dpi=110, metadata={"Software": None})
    return content.getvalue()
