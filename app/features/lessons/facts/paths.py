"""Facts about the path of a method, compared with the true one."""

from __future__ import annotations

from typing import cast, get_args

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.evaluation.metrics import between_stereo_rmse_m, spline_between_stereo_rmse_m
from ispom.evaluation.relative_error import rpe
from ispom.evaluation.scale import StepScale, step_scale
from ispom.evaluation.trajectory_error import MIN_POSES, Alignment, TrajectoryError
from ispom.geometry import Array
from ispom.methods import method as registered
from ispom.types import Trajectory

from ....engine.conditions.evaluate import hits
from ....engine.conditions.parser import parse
from ..ran import Ran


def ate_m(ran: Ran, method: str, alignment: str) -> float:
    """Absolute trajectory error: root mean square distance of the aligned positions from the true ones [m]."""
    return _error(ran, method, alignment).ate_m


def ate_percent(ran: Ran, method: str, alignment: str) -> float:
    """The same as a share of the true path's length [%]."""
    return 100 * ate_m(ran, method, alignment) / _compared(ran, method)[1].length


def rpe_m(ran: Ran, method: str, alignment: str) -> float:
    """Root mean square error of the motion from one pose to the next [m]."""
    error = _error(ran, method, alignment)
    return rpe(error.aligned, error.reference)[0]


def error_at_end_m(ran: Ran, method: str, alignment: str) -> float:
    """Distance of the last position from the true one [m]."""
    return float(_error(ran, method, alignment).position_errors_m[-1])


def metres_per_unit(ran: Ran, method: str) -> float:
    """By which its path has to be multiplied to come closest to the true one."""
    return _error(ran, method, "sim3").reference_from_estimate.scale


def step_scale_end(ran: Ran, method: str) -> float:
    """Estimated over true step length in the last tenth of the path, over that in the first."""
    return _step_scale(ran, method).end_over_start


def step_scale_curve(ran: Ran, method: str) -> tuple[Array, Array]:
    """Along the path [%]: estimated over true step length, over that in its first tenth."""
    windows = np.array(_step_scale(ran, method).windows)
    return 100 * (np.arange(len(windows)) + 0.5) / len(windows), windows


def error_curve(ran: Ran, method: str, alignment: str) -> tuple[Array, Array]:
    """Over time [s]: distance of the positions from the true ones [m], after an alignment."""
    error = _error(ran, method, alignment)
    return (error.reference.times_ns - ran.sequence.times_ns[0]) * 1e-9, error.position_errors_m


def direction_deg(ran: Ran, method: str) -> float:
    """Angle between the estimated and the true direction of the motion from a frame to the next, in the axes of the
    moving frame: the median [deg]."""
    own, true = (_steps_seen(path) for path in _compared(ran, method))
    lengths = np.linalg.norm(own, axis=1) * np.linalg.norm(true, axis=1)
    moved = lengths > 0
    if not moved.any():
        raise InputError(f"{method} or the camera did not move in this run: there is no direction to compare")
    cosines = np.sum(own * true, axis=1)[moved] / lengths[moved]
    return float(np.degrees(np.median(np.arccos(np.clip(cosines, -1, 1)))))


def length_m(ran: Ran, method: str) -> float:
    """Of its path [m, or its own unit]."""
    return ran.path(method).length


def speed_m_per_s(ran: Ran, method: str) -> float:
    """True mean speed of the camera whose poses it gives."""
    true = ran.truth(ran.path(method).frame)
    return true.length / _seconds(true)


def poses_per_s(ran: Ran, method: str) -> float:
    return (len(ran.path(method)) - 1) / _seconds(ran.path(method))


def located_percent(ran: Ran, method: str) -> float:
    """Of the frames that it takes, those with a pose in the end [%]."""
    kinds = np.array(ran.sequence.kinds[: ran.count])
    path = ran.finished.trajectories.get(method)
    return 100 * (len(path) if path is not None else 0) / np.isin(kinds, list(registered(method).sensors)).sum()


def between_stereo_m(ran: Ran, method: str, stereo: str) -> float:
    """Root mean square error of its positions relative to the stereo pose before each [m]."""
    return _known(between_stereo_rmse_m(ran.path(method), ran.path(stereo), ran.truth("rig")))


def spline_between_stereo_m(ran: Ran, method: str, stereo: str) -> float:
    """The same of a spline through the stereo poses alone, at its times [m]."""
    return _known(spline_between_stereo_rmse_m(ran.path(method), ran.path(stereo), ran.truth("rig")))


def _compared(ran: Ran, method: str) -> tuple[Trajectory, Trajectory]:
    own, true = ran.compared(method)
    if len(own) < MIN_POSES:
        raise InputError(f"{method} has {len(own)} poses with a known truth, {MIN_POSES} are needed")
    return own, true


def _steps_seen(path: Trajectory) -> Array:
    """(N - 1, 3) from each position to the next, in the axes of the moving frame."""
    return np.einsum("nji,nj->ni", path.rotations[:-1], np.diff(path.translations, axis=0))


def _error(ran: Ran, method: str, alignment: str) -> TrajectoryError:
    return TrajectoryError(*_compared(ran, method), _kind(alignment))


def _step_scale(ran: Ran, method: str) -> StepScale:
    found = step_scale(*_compared(ran, method))
    if found is None:
        raise InputError(f"the path of {method} is too short for its step scale: take a longer source")
    return found


def _kind(text: str) -> Alignment:
    if text not in get_args(Alignment):
        raise InputError(f"{text!r} is no alignment: choose from {', '.join(get_args(Alignment))}")
    return cast(Alignment, text)


def _known(value: float | None) -> float:
    if value is None:
        raise InputError("no pose of the method lies between two stereo poses: there is nothing to compare")
    return value


def _seconds(path: Trajectory) -> float:
    return float(path.times_ns[-1] - path.times_ns[0]) * 1e-9


def median(ran: Ran, quantity: str) -> float:
    """Over the frames that have a value."""
    return float(np.median(_frames_and_values(ran, quantity)[1]))


def largest(ran: Ran, quantity: str) -> float:
    return float(np.max(_frames_and_values(ran, quantity)[1]))


def total(ran: Ran, quantity: str) -> float:
    """Of a flag, how often it was true."""
    return float(np.sum(_frames_and_values(ran, quantity)[1]))


def last(ran: Ran, quantity: str) -> float:
    return float(_frames_and_values(ran, quantity)[1][-1])


def holds_percent(ran: Ran, condition: str) -> float:
    """At which share of the frames on which its methods stepped a condition holds [%]."""
    expression = parse(condition, ran.series.quantities)
    stepped = sum(ran.series.stepped(expression.methods, i) for i in range(ran.count))
    return 100 * hits(expression, ran.series, ran.count) / max(stepped, 1)


def quantity_curve(ran: Ran, quantity: str) -> tuple[Array, Array]:
    """Over time since the first frame [s]."""
    at, values = _frames_and_values(ran, quantity)
    return (ran.sequence.times_ns[at] - ran.sequence.times_ns[0]) * 1e-9, values


def _frames_and_values(ran: Ran, quantity: str) -> tuple[NDArray[np.int64], Array]:
    if quantity not in ran.series.quantities:
        raise InputError(f"{quantity!r} is no quantity of this run: give METHOD.KEY")
    at, values = ran.series.values_of(quantity, ran.count)
    known = np.isfinite(values)
    if not known.any():
        raise InputError(f"nothing was said of {quantity} in this run")
    return at[known], values[known]
