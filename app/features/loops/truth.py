"""Whether the relative pose of a candidate is right, where the ground truth is known."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from ispom.estimators.modern.loops.find import AGREEING_DEG, AGREEING_DEPTHS, DEVIATIONS, MAX_SCALE
from ispom.estimators.modern.trials import Trial
from ispom.evaluation.trajectory_error import alignment_of, error_against_truth
from ispom.geometry import Pose, rotation_angle_rad
from ispom.methods import method as registered
from ispom.types import FrameName, Sequence, Trajectory

from ...engine.playback import Playback
from .candidate import Candidate, Truth, candidate_of


def errors_ate(playback: Playback, trajectories: Mapping[str, Trajectory]) -> dict[str, tuple[float, float]]:
    """By method: the ATE [m], and the unit [m] of its world by the alignment; without truth, or poses, none."""
    found = dict[str, tuple[float, float]]()
    if (truth := playback.truth) is None:
        return found
    for name, trajectory in trajectories.items():
        kind = alignment_of(registered(name).unit == "metric")
        error = error_against_truth(trajectory, truth, playback.sequence.rig, kind)
        if error is not None:
            found[name] = error.ate_m, error.reference_from_estimate.scale
    return found


def with_truth(found: Candidate, sequence: Sequence, units_m: Mapping[str, float]) -> Candidate:
    """Returns the candidate with its error, where that is known."""
    first, then = (true_pose(sequence, found.camera, t) for t in (found.first_ns, found.then_ns))
    unit, pose = units_m.get(found.method), found.pose
    if first is None or then is None or unit is None or pose is None:
        return found
    true = first.inverse() @ then
    way, free = np.array(pose.translation) * unit, 0.0 if found.method == "stereo" else MAX_SCALE
    # The unit of one camera drifts: the one that fits best, within that drift, is taken.
    fitted = float(way @ true.translation / max(float(way @ way), 1e-12)) if free else 1.0
    off = float(np.linalg.norm(np.clip(fitted, np.exp(-free), np.exp(free)) * way - true.translation))
    rotation = Rotation.from_quat(pose.rotation_xyzw).as_matrix()
    turned = float(np.degrees(rotation_angle_rad(true.rotation.T @ rotation)))
    away = AGREEING_DEPTHS * (pose.depth or 0.0) * unit
    if pose.translation_sigma is not None and pose.turn_sigma_deg is not None:
        away += DEVIATIONS * unit * float(np.linalg.norm(pose.translation_sigma))
    tilt = AGREEING_DEG + DEVIATIONS * (pose.turn_sigma_deg or 0.0)
    right = off <= away and turned <= tilt
    distance = float(np.linalg.norm(true.translation))
    return msgspec.structs.replace(found, truth=Truth(off, turned, right, distance))


def judged_trial(one: Trial, sequence: Sequence, units_m: Mapping[str, float]) -> Candidate:
    """Returns a trial as a candidate, with its error where that is known."""
    return with_truth(candidate_of(one, sequence), sequence, units_m)


def true_pose(sequence: Sequence, camera: FrameName, time_ns: int) -> Pose | None:
    """world_from_camera by the ground truth; None where it has no pose at that time."""
    rig = None if sequence.truth is None else sequence.truth.at(time_ns)
    return None if rig is None else rig @ sequence.rig.rig_from(camera)
