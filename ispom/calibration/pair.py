"""A stereo pair: its common frame, and the rows of its rectified images."""

from __future__ import annotations

import numpy as np

from ispom.calibration.adjust.problem import Estimate, Observations
from ispom.calibration.result import RowError
from ispom.errors import InputError
from ispom.geometry import Array, Pose, rotation_between, so3_exp, so3_log
from ispom.io.calibrations.pair import pair_fault
from ispom.types import Rig


def rectifying(right_from_left: Pose) -> tuple[Pose, Pose]:
    """Returns rig_from_left and rig_from_right: the rig is at the middle of the baseline, its x axis along it (Fig.
    6).

    Its rotation is otherwise half of that from one camera to the other, as in cv2.stereoRectify.
    """
    left_from_right = right_from_left.inverse()
    half = so3_exp(so3_log(left_from_right.rotation) / 2)  # left_from_middle
    baseline = half.T @ left_from_right.translation
    turn = rotation_between(baseline, np.array([1.0, 0, 0])) @ half.T
    left = Pose(turn, -turn @ left_from_right.translation / 2)
    return left, left @ left_from_right


def with_usual_frame(rig: Rig) -> Rig:
    """Returns a rig whose frame is that of its left camera, as other programs have it, with its frame at the middle of
    the baseline (Fig. 6). Unchanged are others, and cameras that are not side by side: they would be turned."""
    if not rig.has_stereo or not np.array_equal(rig.rig_from_left.matrix, np.eye(4)):
        return rig
    if pair_fault(rig.rig_from_left.inverse() @ rig.rig_from_right):
        return rig
    left, right = rectifying(rig.rig_from_right.inverse() @ rig.rig_from_left)
    new_from_old = left @ rig.rig_from_left.inverse()
    moved = {f"rig_from_{name}": new_from_old @ sensor.rig_from_sensor for name, sensor in rig.sensors.items()}
    return rig.changed(**{**moved, "rig_from_left": left, "rig_from_right": right})


def row_error(estimate: Estimate, seen: Observations) -> RowError:
    """Compares all points that both cameras of an estimate observed in one view."""
    keys = seen.view * (int(seen.point.max()) + 1) + seen.point
    first, second = seen.camera == 0, seen.camera == 1
    _, a, b = np.intersect1d(keys[first], keys[second], return_indices=True)
    uv = (seen.uv[first][a], seen.uv[second][b])
    placed = rectifying(estimate.camera_from_rig[1] @ estimate.camera_from_rig[0].inverse())
    focal_px = float(np.mean([camera.fy for camera in estimate.cameras[:2]]))
    rows = [_row(estimate, c, uv[c], placed[c].rotation) for c in (0, 1)]
    return RowError(uv[0], focal_px * (rows[0] - rows[1]))


def require_order(right_from_left: Pose) -> None:
    """Raises InputError where the right camera is to the left of the left one."""
    x, y, _ = right_from_left.inverse().translation
    if x < 0 and abs(x) > abs(y):
        raise InputError(
            f"the camera given as right is {-x:.3f} m to the left of the one given as left: left and right are swapped "
            "(or all images are mirrored), give them the other way round"
        )


def _row(estimate: Estimate, c: int, uv: Array, turn: Array) -> Array:
    """Returns y / z (N,) in the rectified camera."""
    rays = np.column_stack([estimate.cameras[c].normalise(uv), np.ones(len(uv))]) @ turn.T
    return rays[:, 1] / rays[:, 2]
