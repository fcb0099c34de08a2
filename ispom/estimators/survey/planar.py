"""Visual odometry in the plane: the "VO in 2-D" of the paper's Table 1, with three degrees of freedom.

The platform is taken to move in the plane of the left camera's x and z axes, as a vehicle with a level camera does:
each motion is two translations and one rotation about the camera's y axis. Points of the last pair have a depth; the
motion is the one that carries them onto their images in the present pair, by Gauss-Newton with a robust loss
(Scaramuzza and Fraundorfer, Visual Odometry, Part I, 2011, section "motion from 3-D to 2-D").

Its limit is the motion out of the plane: on a hill, or with a camera that pitches and rolls, the rows of the image
contradict it. The check `out_of_plane` measures this; the path stays flat whatever the road does. After a pair that was
not located it starts again at the last position, in a new segment. KITTI 06: 2.7 % of the distance in the first 51
pairs. The flight of sim:tiny, which is no motion in a plane, is lost in most pairs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ispom.estimator import STEREO, Method
from ispom.estimators.survey.common import OneKind, Result, tracks_between
from ispom.features.klt import Klt
from ispom.features.row_search import RowSearch
from ispom.features.shi_tomasi import detect_corners
from ispom.geometry import Array, Pose
from ispom.numerics.robust import robust_weights
from ispom.settings import Range, WorthTrying, checked
from ispom.solvers.multiview.triangulation import points_from_disparity
from ispom.stopwatch import Stopwatch
from ispom.types import Check, Frame, Image, Landmarks, Rig, Tracks, TrackStatus, as_grey, by_key, colours_at

ITERATIONS = 15
"""Most iterations of Gauss-Newton; from the last motion it needs about five."""
LOSS_PX = 1.0
"""Width of the robust loss: about twice the deviation of tracked corners."""
INLIER_PX = 3.0
"""An image point farther than this from its prediction is an outlier: three widths of the loss."""
NOTHING = np.zeros(0, np.int64), np.zeros((0, 2), np.float32), np.zeros((0, 3))
"""Ids, places and points of none."""
MIN_DISPARITY_PX = 2.0
"""Least disparity for a depth: with a smaller one, an error of half a pixel is one of a quarter of the depth and
more."""

INLIERS = Check(
    "planar_inliers",
    "points that agree with one motion in the plane",
    "requirement",
    "Located?",
    passes="Tracking: {value} points agree with one motion in the plane (minimum {threshold}).",
    fails="Lost: {value} points agree with one motion in the plane ({threshold} needed).",
    topic="pose",
)
OUT_OF_PLANE = Check(
    "out_of_plane",
    "median distance of the rows from a motion in the plane",
    "warning",
    relation="<=",
    unit="px",
    passes="The motion stays in the plane: rows differ by {value} px (limit {threshold} px).",
    fails="Not in the plane: rows differ by {value} px (limit {threshold} px), as the camera pitches, rolls or climbs.",
)


@dataclass(frozen=True)
class PlanarConfig:
    """Settings of `planar`."""

    max_points: Annotated[int, Range(50, 3000), WorthTrying((2,))] = 600
    """Corners tracked at a time."""
    min_inliers: Annotated[int, Range(6, 500)] = 20
    """Fewer points that agree with one motion, and the pair is not located."""
    max_out_of_plane_px: Annotated[float, Range(0.1, 50.0)] = 1.5
    """Median distance of the rows [px] from which on the motion is reported as not in the plane."""

    def build(self, rig: Rig) -> Planar:
        """Returns the estimator for the rig's stereo pair."""
        return Planar(rig, checked(self))


@dataclass(frozen=True, eq=False)
class Memory:
    """The last pair, with its pose and its points in the left camera."""

    grey: Image
    ids: NDArray[np.int64]
    """(N,)"""
    uv: NDArray[np.float32]
    """(N, 2) [px]."""
    xyz: Array
    """(N, 3) [m] in the left camera; NaN without a depth."""
    world_from_left: Pose
    motion: Array
    """(3,) last motion: x, z [m], and the angle about y [rad]."""
    next_id: int
    lost: bool = False
    """Whether the last pair was not located."""


class Planar(OneKind[Memory | None]):
    kind, frame = "stereo", "rig"

    def __init__(self, rig: Rig, config: PlanarConfig) -> None:
        self.rig, self._config, self._camera = rig, config, rig.camera("left")

    def begin(self) -> Memory | None:
        return None

    def process(self, memory: Memory | None, frame: Frame, watch: Stopwatch) -> tuple[Memory, Result]:
        left = as_grey(frame.left)
        if memory is None:
            memory = Memory(left, *NOTHING, self.rig.rig_from_left, np.zeros(3), 0)
            after = self._with_points(memory, frame, memory.ids, memory.uv)
            watch.lap("points")
            enough = INLIERS.of(np.isfinite(after.xyz[:, 0]).sum(), self._config.min_inliers)
            pose = Pose() if enough.passed else None
            return after, Result(pose, (enough,), {"left": tracks_between(after.ids, after.uv)})
        uv, status = Klt(levels=4).track(memory.grey, left, memory.uv)
        watch.lap("track")
        alive = status == TrackStatus.ALIVE
        with_depth = np.flatnonzero(alive & np.isfinite(memory.xyz[:, 0]))
        xyz, x = memory.xyz[with_depth], self._camera.normalise(uv[with_depth])
        motion, distances = fit_planar_motion(xyz, x, memory.motion, LOSS_PX / self._camera.fx)
        agree = distances <= INLIER_PX / self._camera.fx
        decisions = [INLIERS.of(agree.sum(), self._config.min_inliers)]
        watch.lap("motion")
        if not decisions[0].passed:
            lost = replace(memory, motion=np.zeros(3), lost=True)
            after = self._with_points(lost, frame, memory.ids[alive], uv[alive])
            return after, Result(None, (decisions[0],), {"left": self._shown(memory, uv, status, alive)})
        seen = planar_pose(motion).apply(xyz[agree])
        off_rows = np.abs(x[agree, 1] - seen[:, 1] / seen[:, 2]) * self._camera.fy
        decisions.append(OUT_OF_PLANE.of(np.median(off_rows), self._config.max_out_of_plane_px))
        inliers = alive.copy()
        inliers[with_depth[~agree]] = False
        world_from_left = memory.world_from_left @ planar_pose(motion).inverse()
        moved = Memory(left, *NOTHING, world_from_left, motion, memory.next_id)
        after = self._with_points(moved, frame, memory.ids[inliers], uv[inliers])
        watch.lap("points")
        return after, Result(
            world_from_left @ self.rig.rig_from_left.inverse(),
            tuple(decisions),
            {"left": self._shown(memory, uv, status, inliers)},
            _landmarks(after, frame),
            self._camera.fx * distances[agree],
            restarted=memory.lost,
        )

    def _shown(
        self, memory: Memory, uv: NDArray[np.float32], status: NDArray[np.uint8], inliers: NDArray[np.bool_]
    ) -> Tracks:
        """Tracks for display: those that KLT lost end where they were."""
        alive = status == TrackStatus.ALIVE
        ended = np.where(alive & ~inliers, np.uint8(TrackStatus.RIGID), status)
        return Tracks.of(memory.ids, np.where(alive[:, None], uv, memory.uv), uv_prev=memory.uv, status=ended)

    def _with_points(self, memory: Memory, frame: Frame, ids: NDArray[np.int64], uv: NDArray[np.float32]) -> Memory:
        """Keeps these points (N,), (N, 2), adds corners where there are none, and gives all a depth from the pair."""
        left, right, n = as_grey(frame.left), as_grey(frame.right), len(ids)
        new = detect_corners(left, self._config.max_points - n, uv)
        uv = np.concatenate([uv, new])
        ids = np.concatenate([ids, memory.next_id + np.arange(len(new))])
        disparity, _ = RowSearch().disparity(left, right, uv)
        known = disparity >= MIN_DISPARITY_PX
        xyz = np.full((len(uv), 3), np.nan)
        xyz[known] = points_from_disparity(self._camera, self.rig.baseline_m, uv[known], disparity[known])
        return replace(memory, grey=left, ids=ids, uv=uv, xyz=xyz, next_id=memory.next_id + len(new))


def planar_pose(motion: Array) -> Pose:
    """Returns now_from_before of a motion (3,): translation along x and z [m], and rotation about y [rad]."""
    c, s = np.cos(motion[2]), np.sin(motion[2])
    return Pose(np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]), np.array([motion[0], 0, motion[1]]))


def fit_planar_motion(xyz: Array, x: Array, start: Array, width: float) -> tuple[Array, Array]:
    """Returns the motion (3,) that carries points (N, 3) [m] onto normalised image points (N, 2), and distances (N,).

    Gauss-Newton from `start` (3,), with robust weights of `width`, wider at first. Points behind the camera have no
    weight, and the distance infinity.
    """
    motion = np.array(start, float)
    for i in range(ITERATIONS):
        residuals, jacobian, ahead = _linearised(xyz, x, motion)
        if ahead.sum() < 3:
            break
        squares = (residuals**2).sum(1)
        wide = max(width, float(np.sqrt(np.median(squares[ahead])))) if i < ITERATIONS // 2 else width
        weights = np.where(ahead, robust_weights(squares, wide), 0.0)
        normal = np.einsum("n,nij,nik->jk", weights, jacobian, jacobian)
        gradient = np.einsum("n,nij,ni->j", weights, jacobian, residuals)
        motion = motion - np.linalg.lstsq(normal, gradient, rcond=None)[0]
    residuals, _, ahead = _linearised(xyz, x, motion)
    return motion, np.where(ahead, np.linalg.norm(residuals, axis=1), np.inf)


def _linearised(xyz: Array, x: Array, motion: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Residuals (N, 2) in the image, their Jacobian (N, 2, 3), and which points (N,) are ahead of the camera."""
    moved = planar_pose(motion).apply(xyz)
    ahead = moved[:, 2] > 0.1
    px, py, pz = moved[:, 0], moved[:, 1], np.where(ahead, moved[:, 2], 1.0)
    turned_x, turned_z = moved[:, 2] - motion[1], -(px - motion[0])
    jacobian = np.zeros((len(xyz), 2, 3))
    jacobian[:, 0, 0] = 1 / pz
    jacobian[:, 0, 1] = -px / pz**2
    jacobian[:, 1, 1] = -py / pz**2
    jacobian[:, 0, 2] = turned_x / pz - px * turned_z / pz**2
    jacobian[:, 1, 2] = -py * turned_z / pz**2
    return np.column_stack([px / pz - x[:, 0], py / pz - x[:, 1]]), jacobian, ahead


def _landmarks(memory: Memory, frame: Frame) -> Landmarks:
    known = np.isfinite(memory.xyz[:, 0])
    xyz = memory.world_from_left.apply(memory.xyz[known])
    return Landmarks(memory.ids[known], xyz, colours_at(frame.left, memory.uv[known]))


METHOD = Method(
    "planar",
    STEREO,
    PlanarConfig,
    "metric",
    "Scaramuzza and Fraundorfer, Visual Odometry, Part I (2011)",
    checks=by_key(INLIERS, OUT_OF_PLANE),
    stages={
        "track": "Follows the corners of the last left image.",
        "motion": "Fits two translations and one rotation to them.",
        "points": "Adds corners, and measures depths in the pair.",
    },
    survey="Table 1: visual odometry in the plane",
)
