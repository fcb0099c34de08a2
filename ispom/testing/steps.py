"""Checks that Steps are complete, of the right shapes and kinds, and consistent with earlier ones."""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass, field
from typing import get_args

import numpy as np

from ispom.geometry import Array, Pose, rotation_angle_rad
from ispom.methods import method as registered
from ispom.methods import names
from ispom.testing.trial import Trial, Walk
from ispom.types import (
    Camera,
    Decision,
    DecisionKind,
    FrameName,
    Landmarks,
    Status,
    Step,
    Tracks,
    TrackStatus,
    Trajectory,
)

KEY = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
RELATIONS = frozenset({">=", "<=", ">", "<", "="})
KINDS = frozenset(get_args(DecisionKind))
FINAL_SHARE = 0.01
"""Poses declared final may move by this share of the path so far, and rotate by this angle [rad]."""
CODES = [int(status) for status in TrackStatus]


def check_steps(trial: Trial, walk: Walk) -> None:
    """Checks every Step by itself, and against those before it."""
    history = _History(trial)
    for numbered, step in zip(trial.frames, walk.steps, strict=True):
        place, time_ns = numbered.place, numbered.frame.time_ns
        trial.require(step.time_ns == time_ns, f"gives a Step of the time {step.time_ns} ns", place)
        for part in (step, *step.parts):
            _check_values(trial, part, place)
        _check_poses(trial, step, place)
        history.add(step, place)
    located = any(step.status is Status.TRACKING for step in walk.steps)
    trial.require(located, "never tracks: its status is initialising or lost at all frames")


def _check_values(trial: Trial, step: Step, place: str) -> None:
    def require(condition: object, what: str) -> None:
        trial.require(condition, what, place)

    require(isinstance(step.status, Status), f"has the status {step.status!r}, which is none")
    known = {"world", "rig", "board", "body", *trial.rig.sensors}
    require(step.frame in known, f"gives poses of the frame {step.frame!r}, which is none")
    timed = step.seconds and all(seconds >= 0 for seconds in step.seconds.values())
    require(timed, "gives no wall time of its stages in Step.seconds")
    pixels = np.asarray(step.residuals_px)
    require(pixels.ndim == 1 and (pixels >= 0).all(), "has residuals that are no list of pixels from 0 on")
    require(step.scale is None or step.scale > 0, "has a scale factor that is not positive")
    require(step.scale_sigma is None or step.scale_sigma >= 0, "has a negative standard deviation of its scale")
    if step.covariance is not None:
        require(_is_covariance(step.covariance), "has a covariance that is not (6, 6), symmetric and semidefinite")
    for name, tracks in step.tracks.items():
        wrong = _wrong_tracks(tracks, trial.rig.cameras.get(name))
        require(wrong is None, f"has tracks in the camera {name} {wrong}")
    for name, tracks in step.other_motion.items():
        wrong = _wrong_tracks(tracks, trial.rig.cameras.get(name))
        require(wrong is None, f"has tracks of another motion in the camera {name} {wrong}")
    wrong = _wrong_landmarks(step.landmarks)
    require(wrong is None, f"has landmarks {wrong}")
    checks = registered(step.method).checks if step.method in names() else {}
    for decision in step.decisions:
        of_pose = decision.key in checks and checks[decision.key].topic == "pose" and decision.passed
        if of_pose and decision.name.startswith("inliers of") and step.status is Status.TRACKING:
            same = decision.value == len(step.residuals_px)
            require(same, f"counts {decision.value:g} {decision.name}, and has {len(step.residuals_px)} residuals_px")
    made = [(decision.key, decision.about) for decision in step.decisions]
    require(len(set(made)) == len(made), "has a check twice in one Step: distinguish them by Decision.about")
    for decision in step.decisions:
        wrong = _wrong_decision(decision)
        require(wrong is None, f"has a check {decision.key!r} {wrong}")


def _check_poses(trial: Trial, step: Step, place: str) -> None:
    poses = [] if step.world_from_frame is None else [step.world_from_frame]
    for pose in (*poses, *(pose for _, pose in step.revised.items())):
        rotates = np.allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-9)
        trial.require(rotates and np.isfinite(pose.translation).all(), "gives a pose that is no rigid motion", place)
    times = step.revised.times_ns
    trial.require((np.diff(times) > 0).all(), "revises poses at times that do not increase", place)
    trial.require((times <= step.time_ns).all(), "revises poses of later frames", place)


@dataclass
class _History:
    """The Steps of one run so far."""

    trial: Trial
    frame: FrameName | None = None
    poses: dict[int, Pose] = field(default_factory=dict)
    times: set[int] = field(default_factory=set)
    final_ns: int | None = None
    path: float = 0.0
    ended: dict[str, set[int]] = field(default_factory=lambda: defaultdict(set))

    def add(self, step: Step, place: str) -> None:
        self._frames(step, place)
        self._decisions(step, place)
        self._tracks(step, place)
        self._final(step, place)

    def _frames(self, step: Step, place: str) -> None:
        self.frame = self.frame or step.frame
        same = step.frame == self.frame and (not len(step.revised) or step.revised.frame == self.frame)
        self.trial.require(same, f"gives poses of the frame {step.frame} after some of the frame {self.frame}", place)

    def _decisions(self, step: Step, place: str) -> None:
        declared = self.trial.method.checks
        for d in step.decisions:
            self.trial.require(d.key in declared, f"makes a check {d.key!r} that is not in Method.checks", place)
            described = declared[d.key]
            known = (described.name, described.unit, described.relation, described.question, described.kind)
            now = (d.name, d.unit, d.relation, d.question, d.kind)
            self.trial.require(now == known, f"describes its check {d.key!r} in two ways, {known} and {now}", place)

    def _tracks(self, step: Step, place: str) -> None:
        for camera, tracks in step.tracks.items():
            again = self.ended[camera].intersection(tracks.ids.tolist())
            what = f"has a track {min(again, default=0)} in the camera {camera} that had ended before"
            self.trial.require(not again, what, place)
            self.ended[camera] |= set(tracks.ids[tracks.status >= TrackStatus.LOST].tolist())

    def _final(self, step: Step, place: str) -> None:
        """Checks that only poses of frames are revised, and hardly those that were declared final."""
        self.times.add(step.time_ns)
        for time_ns, pose in step.revised.items():
            self.trial.require(time_ns in self.times, "revises a pose at a time of no frame", place)
            if self.final_ns is not None and time_ns < self.final_ns:
                before = self.poses.get(time_ns)
                small = before is not None and _moves_little(before, pose, self.path)
                self.trial.require(small, f"revises the pose of {time_ns} ns, which was declared final", place)
            self.poses[time_ns] = pose
        if step.world_from_frame is not None:
            self.poses[step.time_ns] = step.world_from_frame
        if step.final_until_ns is not None:
            falls = self.final_ns is not None and step.final_until_ns < self.final_ns
            self.trial.require(not falls, "takes back what it declared final", place)
            self.final_ns = step.final_until_ns
        self.path = Trajectory.of(list(self.poses.items())).length


def _moves_little(before: Pose, after: Pose, path: float) -> bool:
    change = before.inverse() @ after
    turned = float(rotation_angle_rad(change.rotation))
    return float(np.linalg.norm(change.translation)) <= FINAL_SHARE * path and turned <= FINAL_SHARE


def _is_covariance(covariance: Array) -> bool:
    if covariance.shape != (6, 6) or not np.isfinite(covariance).all():
        return False
    largest = float(np.abs(covariance).max())
    symmetric = np.allclose(covariance, covariance.T, rtol=0, atol=1e-9 * largest)
    return symmetric and bool(np.linalg.eigvalsh(covariance).min() >= -1e-9 * largest)


def _wrong_tracks(tracks: Tracks, camera: Camera | None) -> str | None:
    n, of_float = len(tracks.ids), (tracks.uv, tracks.uv_prev, tracks.residual_px, tracks.disparity_px)
    if camera is None:
        return "which the rig does not have"
    if [a.shape for a in (*of_float, tracks.status)] != [(n, 2), (n, 2), (n,), (n,), (n,)]:
        return f"whose arrays do not all have {n} rows as Tracks says"
    kinds = (tracks.ids.dtype, tracks.status.dtype, *(a.dtype for a in of_float))
    if kinds != (np.int64, np.uint8, *[np.float32] * 4):
        return "whose arrays are not int64 (ids), uint8 (status) and float32"
    if len(np.unique(tracks.ids)) != n:
        return "whose ids are not unique"
    if not np.isin(tracks.status, CODES).all():
        return "with a status that is no TrackStatus"
    if not ((tracks.uv > -1) & (tracks.uv < (camera.width, camera.height))).all():
        return "outside of its image"
    if not np.isnan(tracks.uv_prev[tracks.status == TrackStatus.NEW]).all():
        return "which are new and have a position in the image before (give NaN)"
    return "with a negative residual" if (tracks.residual_px < 0).any() else None


def _wrong_landmarks(landmarks: Landmarks) -> str | None:
    n = len(landmarks.ids)
    if landmarks.xyz_in_world.shape != (n, 3) or landmarks.rgb.shape != (n, 3):
        return "whose arrays do not all have one row per id"
    if landmarks.ids.dtype != np.int64 or landmarks.rgb.dtype != np.uint8:
        return "whose arrays are not int64 (ids) and uint8 (rgb)"
    return "whose ids are not unique" if len(np.unique(landmarks.ids)) != n else None


def _wrong_decision(decision: Decision) -> str | None:
    if not KEY.fullmatch(decision.key):
        return "whose key is not of small letters, digits and single underscores"
    if decision.relation not in RELATIONS or decision.kind not in KINDS:
        return f"of the kind {decision.kind!r} with the relation {decision.relation!r}: one of them is none"
    if decision.question and not decision.question.endswith("?"):
        return f"whose question is none: {decision.question!r}"
    if decision.kind == "trigger" and not decision.question:
        return "which is a trigger, but of no question"
    if not isinstance(decision.passed, bool):
        return "that neither passed nor failed: give a bool"
    return None if str(decision) and decision.name else "without a name"
