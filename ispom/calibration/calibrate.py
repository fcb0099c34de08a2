"""The three calibrations, each from detections of one target: one camera, a stereo pair, or all cameras of the rig."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.calibration.adjust.lens import MODELS, Model, as_model
from ispom.calibration.adjust.problem import Estimate, Observations, Unknowns
from ispom.calibration.adjust.solve import Solution, adjust_views, solution, solve, start_of, with_views
from ispom.calibration.clock import VIDEO, own_times, with_clock, with_video_placed
from ispom.calibration.detection.detection import Detection
from ispom.calibration.diagnostics import correlations, coverage, difference_map, parameters, uncertainty_map
from ispom.calibration.line_delay import Film, with_line_delay
from ispom.calibration.models import Choice, Trial, chosen, trials_of
from ispom.calibration.pair import rectifying, require_order, row_error
from ispom.calibration.result import Calibration, CameraResult, Clock, LineDelay, Redo, Rejected, Views, verdict
from ispom.calibration.targets.target import Target
from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.types import Rig

LEAST_VIEWS = 3
"""Fewer views do not determine the interior of a camera."""
Progress = Callable[[str], None]


def calibrate(
    target: Target,
    views: tuple[Views, ...],
    choice: Choice = "auto",
    joint: bool = True,
    progress: Progress = lambda _: None,
    most_offset_s: float = 0.5,
    around: Views | None = None,
) -> Calibration:
    """Calibrates cameras whose images of the same number were taken at the same time; the first one is the rig.

    Left, right and video whose images have times: the video's are its own, with a clock offset of at most
    `most_offset_s`. With `joint`, interiors are adjusted together with the cameras' poses; otherwise each camera's own
    views determine its interior. For one camera, images `around` its views (the same, and two before and after each)
    determine the line delay of its shutter. Raises Redo for too few views, InputError where left and right are
    exchanged.
    """
    for each in views:
        good = sum(not d.reason for d in each.detections)
        if good < LEAST_VIEWS:
            raise Redo(_too_few(each, good))
    alone = [_alone(target, each, choice, progress) for each in views]
    model = MODELS[max(MODELS.index(trial.model) for _, trial, _ in alone)]
    estimates = [_as_chosen(found, trial, model, each) for (found, trial, _), each in zip(alone, views, strict=True)]
    begun = None
    if own_times(views):
        progress("comparing how the cameras turned")
        views, begun = with_clock(target, views, [estimate.cameras[0] for estimate in estimates], most_offset_s)
    image_of = _image_of(views, begun is not None)
    nothing = Detection()
    seen = Observations.of(
        target,
        [[each.detections[i] if i >= 0 else nothing for i in image_of[:, c]] for c, each in enumerate(views)],
    )
    progress("solving all cameras together" if len(views) > 1 else "solving")
    apart = VIDEO if begun is not None else None
    start = _together(target, views, estimates, seen, apart)
    unknowns = Unknowns.all_of(start, interior=joint or len(views) == 1, apart=apart)
    found, keep = solve(start, seen, unknowns)
    if not joint and len(views) > 1:
        found = solution(found.estimate, found.seen, Unknowns.all_of(start, apart=apart))
    if len(views) > 1 and {views[0].name, views[1].name} == {"left", "right"}:
        require_order(found.estimate.camera_from_rig[1])
    line_delay = None
    if around is not None and len(views) == 1:
        progress("looking for a rolling shutter")
        found, line_delay = _with_line_delay(target, found, views[0], around, image_of[:, 0])
    progress("solving two halves of the views apart")
    halves = _halves(found)
    clock = None
    if begun is not None:
        found, clock = with_video_placed(found, views, image_of, begun)
    return _result(
        views, [trials for _, _, trials in alone], found, halves, image_of, seen, keep, clock, line_delay, target
    )


def _image_of(views: tuple[Views, ...], apart: bool) -> NDArray[np.int64]:
    """Returns which image of each camera a view is (V, C), -1 for none; only views in which a camera observes the
    target."""
    good = [np.array([not d.reason for d in each.detections]) for each in views]
    if not apart:
        shown = np.flatnonzero(np.any(good, axis=0))
        return np.repeat(shown[:, None], len(views), axis=1)
    pairs, own = np.flatnonzero(good[0] | good[1]), np.flatnonzero(good[VIDEO])
    out = np.full((len(pairs) + len(own), 3), -1)
    out[: len(pairs), :VIDEO] = pairs[:, None]
    out[len(pairs) :, VIDEO] = own
    return out


def _with_line_delay(
    target: Target, found: Solution, views: Views, around: Views, image_of: NDArray[np.int64]
) -> tuple[Solution, LineDelay | None]:
    """Estimates the line delay from the camera's motion around its views."""
    times_ns = views.known_times_ns[image_of]
    zero_ns = int(times_ns[0])
    film = Film.of(target, around, zero_ns)
    return (found, None) if film is None else with_line_delay(found, film, (times_ns - zero_ns) * 1e-9)


def _alone(
    target: Target, views: Views, choice: Choice, progress: Progress
) -> tuple[Solution, Trial, tuple[Trial, ...]]:
    """Returns the camera by its own views: the chosen model's solution."""
    progress(f"{views.name}: comparing camera models" if choice == "auto" else f"{views.name}: solving")
    seen = Observations.of(target, [[d for d in views.detections if not d.reason]])
    trials = trials_of(seen, views.size, choice)
    trial = chosen(trials)
    return trial.solution, trial, trials


def _as_chosen(found: Solution, trial: Trial, model: Model, views: Views) -> Estimate:
    """Returns the camera with the model that all cameras get."""
    if trial.model == model:
        return found.estimate
    if "fisheye" in (model, trial.model):
        return start_of(found.seen.of_views(np.unique(found.seen.view)), views.size, model)
    return replace(found.estimate, cameras=(as_model(found.estimate.cameras[0], model),))


def _together(
    target: Target, views: tuple[Views, ...], alone: list[Estimate], seen: Observations, apart: int | None
) -> Estimate:
    """Returns initial values for all cameras: their poses by the views that two of them share, and the board's
    poses.

    A camera that takes its views `apart` from the others gets the pose of the first one.
    """
    cameras = tuple(estimate.cameras[0] for estimate in alone)
    count = int(seen.view.max()) + 1
    poses: list[list[Pose | None]] = []
    for c, camera in enumerate(cameras):
        mine = seen.select(seen.camera == c)
        present = np.unique(mine.view)
        own = with_views(camera, mine.of_views(present))
        poses.append([None] * count)
        for n, v in enumerate(present):
            poses[c][v] = own.rig_from_board(n)
    placed: list[Pose] = [Pose()]
    for c in range(1, len(cameras)):
        if c == apart:
            placed.append(Pose())
            continue
        shared = [(poses[c][v], poses[0][v]) for v in range(count)]
        candidates = [own @ first.inverse() for own, first in shared if own is not None and first is not None]
        if not candidates:
            raise Redo(
                f"{views[c].name} and {views[0].name} never see the target at the same time: film it where both see it"
            )
        placed.append(_most_agreed(candidates))
    boards = []
    for v in range(count):
        c, own = next((c, poses[c][v]) for c in range(len(cameras)) if poses[c][v] is not None)
        boards.append(placed[c].inverse() @ own)  # type: ignore[operator]
    return Estimate.of(cameras, tuple(placed), boards)


def _most_agreed(candidates: list[Pose]) -> Pose:
    """Returns the pose with the least median difference from the others: [m] and [rad] weigh the same."""
    apart = [[float(np.linalg.norm((a @ b.inverse()).log())) for b in candidates] for a in candidates]
    return candidates[int(np.argmin(np.median(apart, axis=1)))]


def _result(
    views: tuple[Views, ...],
    trials: list[tuple[Trial, ...]],
    found: Solution,
    halves: tuple[Estimate, Estimate] | None,
    image_of: NDArray[np.int64],
    seen: Observations,
    keep: NDArray[np.bool_],
    clock: Clock | None,
    line_delay: LineDelay | None,
    target: Target,
) -> Calibration:
    names = tuple(each.name for each in views)
    cameras = tuple(_camera_result(target, each, c, trials[c], found, halves) for c, each in enumerate(views))
    rows = row_error(found.estimate, found.seen) if names[:2] == ("left", "right") else None
    listed = parameters(found, names)
    of_images = {n: len(np.unique(found.seen.view[found.seen.camera == c])) for c, n in enumerate(names)}
    between = None
    if len(views) > 1 and halves is not None:
        between = halves[0].camera_from_rig[1] @ halves[1].camera_from_rig[1].inverse()
    rig = rig_of(found.estimate, names)
    if line_delay is not None and line_delay.rolls:
        (name,) = names
        camera = replace(found.estimate.cameras[0], line_delay_s=line_delay.seconds)
        rig = rig.changed(**{name: camera})
    return Calibration(
        target=target,
        cameras=cameras,
        solution=found,
        image_of=image_of,
        rig=rig,
        parameters=listed,
        correlations=correlations(found),
        rejected=_rejections(views, seen, keep, image_of),
        row_error=rows,
        halves_pose=between,
        clock=clock,
        line_delay=line_delay,
        verdict=verdict(found, cameras, listed, rows, of_images, clock),
    )


def rig_of(estimate: Estimate, names: tuple[str, ...]) -> Rig:
    """Returns the rig: of a pair centred on its baseline (Fig. 6), of other cameras that of the first."""
    poses = [pose.inverse() for pose in estimate.camera_from_rig]
    if names[:2] == ("left", "right"):
        left, _ = rectifying(estimate.camera_from_rig[1])
        poses = [left @ pose for pose in poses]
    fields: dict[str, object] = {}
    for name, camera, pose in zip(names, estimate.cameras, poses, strict=True):
        fields |= {name: camera, f"rig_from_{name}": pose}
    return Rig.of(**fields)  # type: ignore[arg-type]


def _halves(found: Solution) -> tuple[Estimate, Estimate] | None:
    """Solves two halves of the views separately; None where there are too few views."""
    views = np.unique(found.seen.view)
    if len(views) < 2 * LEAST_VIEWS:
        return None
    out = []
    for part in (views[::2], views[1::2]):
        seen = found.seen.of_views(part)
        start = replace(
            found.estimate, rotations=found.estimate.rotations[part], positions=found.estimate.positions[part]
        )
        out.append(adjust_views(start, seen, found.unknowns, iterations=25))
    return out[0], out[1]


def _camera_result(
    target: Target,
    views: Views,
    c: int,
    trials: tuple[Trial, ...],
    found: Solution,
    halves: tuple[Estimate, Estimate] | None,
) -> CameraResult:
    camera = found.estimate.cameras[c]
    interior, _ = found.unknowns.slices[c]
    one, other = (camera, camera) if halves is None else (halves[0].cameras[c], halves[1].cameras[c])
    mine = found.seen.select(found.seen.camera == c)
    present = np.unique(mine.view)
    poses = [found.estimate.camera_from_rig[c] @ found.estimate.rig_from_board(v) for v in present]
    points: list[Array] = [mine.uv[mine.view == v] for v in present]
    return CameraResult(
        views=views,
        camera=camera,
        trials=trials,
        uncertainty=uncertainty_map(camera, found.covariance[interior, interior]),
        halves=difference_map(one, other),
        coverage=coverage(camera, points, poses, target.xyz_in_board.mean(0)),
    )


def _rejections(
    views: tuple[Views, ...], seen: Observations, keep: NDArray[np.bool_], image_of: NDArray[np.int64]
) -> tuple[Rejected, ...]:
    """Images and points that detection or the solution does not use."""
    out = []
    for c, each in enumerate(views):
        for i, (image, found) in enumerate(zip(each.images, each.detections, strict=True)):
            if found.reason:
                out.append(Rejected(each.name, image, None, found.reason))
                continue
            out += [Rejected(each.name, image, point, reason) for point, reason in found.rejected]
            mine = (seen.camera == c) & (image_of[seen.view, c] == i)
            if not keep[mine].any():
                out.append(Rejected(each.name, image, None, "does not fit the other images"))
            else:
                lost = seen.point[mine & ~keep]
                out += [Rejected(each.name, image, int(point), "does not fit the others") for point in lost]
    return tuple(out)


def _too_few(views: Views, good: int) -> str:
    reasons = [d.reason for d in views.detections if d.reason]
    most = max(set(reasons), key=reasons.count) if reasons else ""
    why = f" ({most} in most of the others)" if most else ""
    count = len(views.images)
    return f"{views.name}: {good} of {count} images show the target{why}, film at least {LEAST_VIEWS}, better 20"


def require_found(views: Views, hint: str) -> None:
    """Raises InputError where no image shows the target; `hint` describes what the images show instead."""
    if any(not d.reason for d in views.detections):
        return
    reasons = [d.reason for d in views.detections]
    most = max(set(reasons), key=reasons.count) if reasons else "no image"
    cure = hint or "give the target that was filmed as --target, or film it sharp and whole"
    raise InputError(f"{views.name}: none of {len(reasons)} images shows the target ({most}): {cure}")
