"""A video camera with times of its own next to a pair: which of its views are used, its pose, and its clock offset."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.calibration.adjust.problem import Estimate, Observations, Unknowns, board_problem
from ispom.calibration.adjust.solve import Solution, board_poses
from ispom.calibration.motion.before_board import placed, views_of
from ispom.calibration.motion.course import LONGEST_S, Course, Start, start_of
from ispom.calibration.result import Clock, Redo, Views
from ispom.calibration.targets.target import Target
from ispom.geometry import Pose
from ispom.solvers.least_squares import normal_equations
from ispom.types import Camera

VIDEO = 2
"""Index of the video camera among left, right, video."""
AROUND = 3
"""Video images before, and as many after, each stereo pair that count."""
OFFSET_S = 0.005
"""A clock offset with a larger error is not determined: a hand shake of 2 degrees rotates as much in it as the
rotation on the rig may be uncertain."""


def own_times(views: tuple[Views, ...]) -> bool:
    """Returns whether the images of a video camera next to a pair have times, close enough to interpolate its poses."""
    if [each.name for each in views] != ["left", "right", "video"]:
        return False
    left, video = views[0].times_ns, views[VIDEO].times_ns
    return left is not None and video is not None and float(np.median(np.diff(video))) * 1e-9 <= LONGEST_S


def with_clock(
    target: Target, views: tuple[Views, ...], cameras: list[Camera], most_offset_s: float
) -> tuple[tuple[Views, ...], Start]:
    """Selects the video's images around the pairs, and returns what the rotations of both cameras give.

    Raises Redo where they share too little time, or do not rotate together.
    """
    zero = _zero(views)
    left, video = (course_of(target, views[c], cameras[c], zero) for c in (0, VIDEO))
    start = start_of(left, video, most_offset_s) if len(video) >= 4 else None
    if start is None:
        raise Redo(
            f"video and pair see the target at the same time too seldom (clocks are taken to agree within "
            f"{most_offset_s:g} s): film it with both, or give a larger --clock-within"
        )
    require_together(start, most_offset_s)
    own = views[VIDEO]
    at = np.searchsorted((own.known_times_ns - zero) * 1e-9, left.times_s - start.offset_s)
    around = np.unique(np.clip(at[:, None] + np.arange(-AROUND, AROUND), 0, len(own.images) - 1))
    return (*views[:VIDEO], own.select(around)), start


def require_together(start: Start, most_offset_s: float) -> None:
    """Raises Redo where the two courses are not of one rig at one time."""
    if not start.together:
        raise Redo(
            f"video and pair do not turn alike at any clock offset within {most_offset_s:g} s "
            f"({100 * start.unexplained:.0f} % of the motion differs): give recordings of one session, of cameras "
            "fixed to each other, or a larger --clock-within"
        )


def with_video_placed(
    found: Solution, views: tuple[Views, ...], image_of: NDArray[np.int64], start: Start
) -> tuple[Solution, Clock]:
    """Returns a solution that includes the video camera's pose, by the views of both, and its clock."""
    zero = _zero(views)
    solved = np.isin(np.arange(len(image_of)), found.seen.view)
    left_seen = np.isin(np.arange(len(image_of)), found.seen.view[found.seen.camera == 0])
    parts = []
    for c, chosen in ((0, left_seen), (VIDEO, solved & (image_of[:, VIDEO] >= 0))):
        index, times_ns = np.flatnonzero(chosen), views[c].known_times_ns
        parts.append(views_of(found, index, (times_ns[image_of[index, c]] - zero) * 1e-9))
    left, video = parts
    finite = np.where(np.isfinite(found.covariance), found.covariance, 0.0)
    best = placed(left, video, finite, _first_pose(left.course, video.course, start), start.offset_s)
    if best is None:
        raise Redo("video and pair see the target at the same time too seldom: film it with both for longer")
    estimate, unknowns = _moved(found.estimate, best.video_from_left, image_of), Unknowns.all_of(found.estimate)
    unknowns = Unknowns(found.unknowns.interior, unknowns.pose)
    covariance = np.block([[found.covariance, best.with_shared[:6].T], [best.with_shared[:6], best.covariance[:6, :6]]])
    equations = normal_equations(board_problem(found.seen, unknowns, estimate.views), estimate)
    error = float(np.sqrt(best.covariance[6, 6]))
    known = 0 < error <= OFFSET_S
    clock = Clock(best.offset_s, error, known)
    return replace(found, estimate=estimate, unknowns=unknowns, covariance=covariance, equations=equations), clock


def _moved(estimate: Estimate, video_from_left: Pose, image_of: NDArray[np.int64]) -> Estimate:
    """Adds the video camera, and its views, at its pose on the rig."""
    own, back = image_of[:, VIDEO] >= 0, video_from_left.inverse()
    rotations, positions = estimate.rotations.copy(), estimate.positions.copy()
    rotations[own] = back.rotation @ rotations[own]
    positions[own] = back.apply(positions[own])
    poses = (*estimate.camera_from_rig[:VIDEO], video_from_left)
    return Estimate(estimate.cameras, poses, rotations, positions)


def _first_pose(left: Course, video: Course, start: Start) -> Pose:
    """Returns video_from_left by the estimated rotation, and the median of the positions."""
    turn = start.left_from_video.T
    seen = video.at(left.times_s - start.offset_s)
    inverse = np.swapaxes(seen.rotations, 1, 2)[seen.known]
    offsets = (inverse @ (left.positions - seen.positions)[seen.known][..., None])[..., 0]
    return Pose(turn, np.median(offsets, axis=0) if len(offsets) else np.zeros(3))


def course_of(target: Target, views: Views, camera: Camera, zero_ns: int) -> Course:
    """Returns board_from_camera of each image that shows the target; times count from `zero_ns`."""
    good = [i for i, d in enumerate(views.detections) if not d.reason]
    seen = Observations.of(target, [[views.detections[i] for i in good]])
    poses = [pose.inverse() for pose in board_poses(camera, seen)]
    times_s = (views.known_times_ns[good] - zero_ns) * 1e-9
    return Course(times_s, np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]))


def _zero(views: tuple[Views, ...]) -> int:
    return int(views[0].known_times_ns[0])
