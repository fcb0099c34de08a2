"""Stereo odometry and GNSS, fused loosely: a Kalman filter of the drift of `stereo` (error state, after Groves 2013).

The filter's state is the correction world_from_odometry (rotation and position at the rig), which drifts with the
way. Each fix, at the pose between the two stereo frames around it, corrects it. What this does not do: fixes correct
no earlier poses, the scale and the images' features are not part of it, the clock of the fixes is taken to be right,
and the rig must stand nearly level at its first frame (`tilt_sigma_deg`), as a straight way does not show its tilt.
Until the way is `start_m` long, poses are those of `stereo`: before that the fixes do not show the heading.
"""

from dataclasses import dataclass, replace
from time import perf_counter
from typing import Annotated

import numpy as np

import ispom

GATE = 16.27  # of chi-square with 3 degrees of freedom: 99.9 %
WAITING = 200  # fixes that are kept until the next stereo frame, or until the way is long enough
ODOMETRY_FROM_LEVEL = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # right, forward, up -> right, down, forward
RESTARTED = np.diag([100.0] * 3 + [0.1] * 3)  # a blind restart of stereo: 10 m, 18 degrees
FIX = ispom.Check("fix", "distance of the fix from the prediction", "warning", relation="<=", topic="pose")


@dataclass(frozen=True)
class GpsStereoConfig:
    drift_percent: Annotated[float, ispom.Range(0.01, 20)] = 1.0
    """Position error of the stereo method that each metre adds, in percent of it."""
    turn_deg: Annotated[float, ispom.Range(0.001, 10)] = 0.1
    """Rotation error that 1 m adds; it grows with the root of the way."""
    tilt_sigma_deg: Annotated[float, ispom.Range(0.1, 30)] = 3.0
    """How far from level the rig may stand at its first frame."""
    start_m: Annotated[float, ispom.Range(0.5, 200)] = 10.0
    """Length of the way from which on fixes are used."""

    def build(self, rig):
        return GpsStereo(rig, self)


@dataclass(frozen=True, eq=False)
class State:
    odometry: tuple = ()  # (time_ns, odometry_from_rig) of the last stereo frame that was located
    status: ispom.Status = ispom.Status.INITIALISING
    waiting: tuple = ()  # fixes later than that frame
    paired: tuple = ()  # (antenna in odometry, fix), while there is no alignment
    world_from_local: ispom.Pose | None = None
    correction: ispom.Pose = ispom.Pose()
    covariance: np.ndarray | None = None  # (6, 6) of position and rotation at the rig, along the world's axes
    corrections: ispom.PersistentList = ispom.PersistentList()  # (time_ns, correction)


@dataclass(frozen=True)
class GpsStereo:
    rig: object
    config: GpsStereoConfig
    start = staticmethod(State)

    def step(self, state, measurement, inputs):
        begun = perf_counter()
        if isinstance(measurement, ispom.GnssFix):
            after = replace(state, waiting=(*state.waiting, measurement)[-WAITING:])
            return after, ispom.Step(measurement.time_ns, state.status, seconds={"wait": perf_counter() - begun})
        part, decisions = inputs["stereo"], []
        state = replace(state, status=part.status)
        pose, covariance = part.world_from_frame, part.covariance
        if pose is not None:
            now = (part.time_ns, pose)
            state = self._predicted(state, now, part.restarted)
            for fix in state.waiting if state.odometry else ():
                state, decision = self._corrected(state, now, fix)
                decisions += [decision] if decision else []
            history = state.corrections.appended((part.time_ns, state.correction))
            state = replace(state, odometry=now, waiting=(), corrections=history)
            pose = state.correction @ pose
            if state.covariance is not None:
                own = np.kron(np.eye(2), pose.rotation.T)
                covariance = own @ state.covariance @ own.T
        return state, ispom.Step(
            part.time_ns, part.status, "rig", pose, covariance, part.key_frame, parts=(part,),
            decisions=tuple(replace(d, about=str(i)) for i, d in enumerate(decisions)),
            restarted=part.restarted, seconds={"fuse": perf_counter() - begun},
        )  # fmt: skip

    def finish(self, state, inputs):
        found, history = [], list(state.corrections)
        times = np.array([time_ns for time_ns, _ in history])
        for time_ns, pose in inputs["stereo"].items():
            i = int(np.searchsorted(times, time_ns, side="right")) - 1
            found.append((time_ns, history[i][1] @ pose if i >= 0 else pose))
        return ispom.Trajectory.of(found)

    def _predicted(self, state, now, restarted):
        """The covariance at the new place of the rig: rotation errors have moved it, and drift was added."""
        if state.covariance is None or not state.odometry:
            return state
        moved = state.correction.rotation @ (now[1].translation - state.odometry[1].translation)
        along = _moving(moved)
        way = float(np.linalg.norm(moved))
        drift = np.full(3, (0.01 * self.config.drift_percent * way) ** 2)
        turn = np.full(3, np.radians(self.config.turn_deg) ** 2 * way)
        covariance = along @ state.covariance @ along.T + np.diag([*drift, *turn]) + (RESTARTED if restarted else 0)
        return replace(state, covariance=covariance)

    def _corrected(self, state, now, fix):
        """By one fix, at the pose between the last two stereo frames."""
        (then_ns, then), (now_ns, pose) = state.odometry, now
        if not then_ns <= fix.time_ns <= now_ns:
            return state, None
        between = then @ ispom.Pose.exp((fix.time_ns - then_ns) / (now_ns - then_ns) * (then.inverse() @ pose).log())
        antenna = between.apply(self.rig.rig_from(fix.sensor).translation)
        if state.world_from_local is None:
            return self._aligned(replace(state, paired=(*state.paired, (antenna, fix))[-WAITING:]), pose), None
        turn = state.world_from_local.rotation
        predicted, rig = state.correction.apply(antenna), state.correction.apply(pose.translation)
        by_error = np.hstack([np.eye(3), -ispom.skew(predicted - rig)])
        noise = turn @ fix.covariance @ turn.T
        spread = by_error @ state.covariance @ by_error.T + noise
        away = state.world_from_local.apply(fix.xyz_in_local) - predicted
        decision = FIX.of(away @ np.linalg.solve(spread, away), GATE)
        if not decision.passed:
            return state, decision
        gain = np.linalg.solve(spread, by_error @ state.covariance).T
        error, left = gain @ away, np.eye(6) - gain @ by_error
        rotation = ispom.Pose.from_rotvec(error[3:], np.zeros(3)).rotation
        about_rig = ispom.Pose(rotation, rig - rotation @ rig + error[:3])
        covariance = left @ state.covariance @ left.T + gain @ noise @ gain.T
        return replace(state, correction=about_rig @ state.correction, covariance=covariance), decision

    def _aligned(self, state, pose):
        """With heading and position of the local frame, once the way is long enough (least squares)."""
        seen = np.array([antenna for antenna, _ in state.paired])
        fixes = np.array([fix.xyz_in_local for _, fix in state.paired])
        if np.linalg.norm(seen - seen[0], axis=1).max() < self.config.start_m:
            return state
        level, local = seen @ ODOMETRY_FROM_LEVEL, fixes - fixes.mean(0)
        x, y = (level - level.mean(0))[:, :2].T
        heading = np.arctan2(local[:, 0] @ y - local[:, 1] @ x, local[:, 0] @ x + local[:, 1] @ y)
        turn = ODOMETRY_FROM_LEVEL @ ispom.Pose.from_rotvec(np.array([0, 0, heading]), np.zeros(3)).rotation
        placed = ispom.Pose(turn, seen.mean(0) - turn @ fixes.mean(0))
        noise = turn @ np.mean([fix.covariance for _, fix in state.paired], axis=0) @ turn.T
        of_heading = np.trace(noise) / 3 / (local[:, :2] ** 2).sum() * np.outer(turn[:, 2], turn[:, 2])
        tilt = np.eye(3) * np.radians(self.config.tilt_sigma_deg) ** 2
        middle = np.block([[noise / len(seen), np.zeros((3, 3))], [np.zeros((3, 3)), tilt + of_heading]])
        along = _moving(pose.translation - seen.mean(0))
        return replace(state, paired=(), world_from_local=placed, covariance=along @ middle @ along.T)


def _moving(shift):
    """(6, 6) from errors of position and rotation at a place to those at another one."""
    return np.block([[np.eye(3), -ispom.skew(shift)], [np.zeros((3, 3)), np.eye(3)]])


METHOD = ispom.Method(
    "gps_stereo", frozenset({"stereo", "gnss"}), GpsStereoConfig, "metric", "Groves 2013, loosely coupled integration",
    asks={"stereo": "stereo"}, checks={"fix": FIX},
    stages={"wait": "Keeps the fix until the next stereo frame.", "fuse": "Corrects the drift by the fixes."},
)  # fmt: skip
