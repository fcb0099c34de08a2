"""Whether the samples of an IMU can be angular velocities in rad/s and specific forces in m/s^2."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ispom.geometry import Array
from ispom.plausibility.doubt import Doubt

GRAVITY = 9.81
LARGEST_RATE = 37.0
"""[rad/s] Gyroscopes of usual IMUs measure up to 2,000 deg/s, which is 35 rad/s."""
TURN_S, TURN_RAD = 2.0, 8 * np.pi
"""Four whole turns within two seconds: the fastest drones roll so for a moment, and their camera sees nothing but blur
(24 degrees per image)."""
LARGEST_FORCE = 160.0
"""[m/s^2] Accelerometers of usual IMUs measure up to 16 g, so that half of the samples stay below it."""
LEAST_FORCE = 6.0
"""[m/s^2] A tenth of the samples at least has more of it where gravity is measured: only a fall from the first sample
to the last has less, or another celestial body."""
IN_G, STEADY = (0.75, 1.3), 0.3
"""Gravity in g with what vehicles add to it, and the relative spread that they do not exceed then."""
OTHER_BODIES = ((1.4, 1.9), (3.4, 4.0))
"""[m/s^2] Moon and Mars."""
HOLE_S, HOLE_STEPS = 0.5, 10
"""Least duration of a hole [s], and its least length in usual intervals. Dead reckoning over 0.5 s at 1 m/s^2 is wrong
by 0.12 m."""
SLOWEST_HZ = 9.5
"""Motion of a hand or a wheel changes within 0.1 s; 10 Hz is the slowest rate of published recordings (KITTI)."""
WINDOWS, STEPS = 40, 100
"""Pieces of a recording in which gravity is followed, and the steps of each."""
FAR_DEG, NEAR_DEG = 25.0, 12.0
"""Accelerations of 2 m/s^2 turn what is measured as gravity by 12 degrees; twice that is no acceleration of a
camera's carrier that lasts."""


def imu_doubts(where: str, times_ns: NDArray[np.int64], rates: Array, forces: Array) -> tuple[Doubt, ...]:
    """Returns doubts about samples: times (N,) [ns], angular velocities (N, 3) and specific forces (N, 3)."""
    if len(times_ns) < 10:
        return ()
    return (*_of_times(where, times_ns), *_of_values(where, times_ns, rates, forces))


def _of_times(where: str, times_ns: NDArray[np.int64]) -> tuple[Doubt, ...]:
    steps_s, out = np.diff(times_ns) * 1e-9, []
    usual_s = float(np.median(steps_s))
    if usual_s * SLOWEST_HZ > 1:
        text = f"{where} has {1 / usual_s:.3g} samples per second, too few to follow a motion: record at 100 Hz or more"
        out.append(Doubt("imu_slow", f"{text}, or use it as it is with care."))
    holes = np.flatnonzero((steps_s >= HOLE_S) & (steps_s >= HOLE_STEPS * usual_s))
    if len(holes):
        i = int(holes[np.argmax(steps_s[holes])])
        text = f"{where} has no samples for {steps_s[i]:.3g} s from {times_ns[i] * 1e-9:.3f} s on"
        more = f" (the longest of {len(holes)} holes)" if len(holes) > 1 else ""
        out.append(Doubt("imu_hole", f"{text}{more}: restore the file; what moves meanwhile is not measured."))
    return tuple(out)


def _of_values(where: str, times_ns: NDArray[np.int64], rates: Array, forces: Array) -> tuple[Doubt, ...]:
    if dead := [n for n, v in (("gyroscope", rates), ("accelerometer", forces)) if not v.any()]:
        both = " and ".join(dead)
        return (Doubt("imu_all_zero", f"{where}: the {both} measures 0 in all {len(rates)} samples: check the file."),)
    rate, force = np.linalg.norm(rates, axis=1), np.linalg.norm(forces, axis=1)
    if _is_gravity(rate) and not np.percentile(force, 90) >= LEAST_FORCE:
        text = f"{where}: its angular velocities have the length of gravity ({np.median(rate):.3g}), and its forces "
        text += f"{np.median(force):.3g}: this looks like exchanged columns; name them the other way round."
        return (Doubt("imu_swapped", text),)
    found = _of_forces(where, force)
    return found + _of_rates(where, times_ns, rates, forces)


def _is_gravity(lengths: Array) -> bool:
    """Whether the values (N,) are those of an accelerometer in m/s^2 on Earth, of a carrier in quiet motion."""
    return bool(7.5 < np.median(lengths) < 12.5 and _spread(lengths) < STEADY)


def _spread(lengths: Array) -> float:
    low, middle, high = np.percentile(lengths, (16, 50, 84))
    return float((high - low) / (2 * middle)) if middle else np.inf


def _of_forces(where: str, force: Array) -> tuple[Doubt, ...]:
    middle, most = (float(v) for v in np.percentile(force, (50, 90)))
    steady = _spread(force) < STEADY
    begin = f"{where}: its accelerometer measures {middle:.3g} m/s^2 (median), where gravity is {GRAVITY} m/s^2"
    if middle > LARGEST_FORCE:
        likely = "mm/s^2, or the converter's counts" if middle > 2000 else "cm/s^2, or the converter's counts"
        return (Doubt("accelerometer_too_large", f"{begin}: this looks like {likely}; give m/s^2."),)
    if most >= LEAST_FORCE:
        return ()
    if steady and IN_G[0] < middle < IN_G[1]:
        return (Doubt("accelerometer_in_g", f"{begin}: this looks like units of g; multiply by {GRAVITY}."),)
    if steady and any(low < middle < high for low, high in OTHER_BODIES):
        return ()
    other = " or units of g" if IN_G[0] < middle < IN_G[1] else ""
    text = f"{begin}: this looks like a recording from which gravity was subtracted{other}, unless all of it is a free "
    return (Doubt("accelerometer_without_gravity", f"{text}fall; give what the accelerometer measures."),)


def _of_rates(where: str, times_ns: NDArray[np.int64], rates: Array, forces: Array) -> tuple[Doubt, ...]:
    cure = "this looks like degrees per second; multiply by pi / 180."
    high = float(np.percentile(np.linalg.norm(rates, axis=1), 99))
    if high > LARGEST_RATE:
        text = f"{where}: its gyroscope measures {high:.3g} rad/s, more than gyroscopes can (35): {cure}"
        return (Doubt("gyroscope_in_degrees", text),)
    t, angle = _integrated(times_ns, rates)
    if t[-1] >= TURN_S:
        starts = np.linspace(0, t[-1] - TURN_S, 200)
        turned = float(np.linalg.norm(_at(starts + TURN_S, t, angle) - _at(starts, t, angle), axis=1).max())
        if turned > TURN_RAD:
            text = f"{where}: its gyroscope turns {turned / (2 * np.pi):.3g} times within {TURN_S:g} s: {cure}"
            return (Doubt("gyroscope_in_degrees", text),)
    as_radians, as_degrees = gravity_errors_deg(t, angle, forces)
    if as_radians > FAR_DEG and as_degrees < min(NEAR_DEG, as_radians / 3):
        text = f"{where}: gravity is {as_radians:.0f} degrees from where its gyroscope has it after "
        text += f"{_horizon_s(t):.3g} s, and {as_degrees:.0f} where its values are degrees: {cure}"
        return (Doubt("gyroscope_in_degrees", text),)
    return ()


def _integrated(times_ns: NDArray[np.int64], rates: Array) -> tuple[Array, Array]:
    """Returns seconds since the first sample (N,) and the integral of the rates (N, K) [rad]; holes count as a few
    intervals."""
    steps = np.diff(times_ns) * 1e-9
    steps = np.minimum(steps, HOLE_STEPS * np.median(steps))
    t = np.append(0.0, np.cumsum(steps))
    means = (rates[1:] + rates[:-1]) / 2
    return t, np.vstack([np.zeros((1, rates.shape[1])), np.cumsum(means * steps[:, None], axis=0)])


def _at(wanted: Array, t: Array, values: Array) -> Array:
    return np.stack([np.interp(wanted, t, column) for column in values.T], axis=-1)


def _horizon_s(t: Array) -> float:
    return min(2.0, float(t[-1]) / 2)


def gravity_errors_deg(t: Array, angle: Array, forces: Array) -> tuple[float, float]:
    """Returns by how much the specific force is elsewhere than the gyroscope says after up to 2 s (median, [deg]): with
    its values as rad/s, and as deg/s.

    `t` (N,) are seconds, `angle` (N, 3) the integral of its values.
    """
    horizon = _horizon_s(t)
    starts = np.linspace(0, t[-1] - horizon, WINDOWS)
    sums = np.vstack([np.zeros((1, 3)), np.cumsum(forces, axis=0)])
    half = max(0.05, min(0.1, horizon / 10))

    def pull(at: Array) -> Array:
        first, last = np.searchsorted(t, at - half), np.searchsorted(t, at + half, "right")
        first = np.minimum(first, len(forces) - 1)
        last = np.maximum(last, first + 1)
        mean = (sums[last] - sums[first]) / (last - first)[:, None]
        return mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)

    errors = []
    for unit in (1.0, np.pi / 180):
        turned = Rotation.identity(WINDOWS)
        for k in range(STEPS):
            begin, end = starts + horizon * k / STEPS, starts + horizon * (k + 1) / STEPS
            turned = turned * Rotation.from_rotvec(unit * (_at(end, t, angle) - _at(begin, t, angle)))
        cosine = np.sum(pull(starts) * turned.apply(pull(starts + horizon)), axis=1)
        errors.append(float(np.degrees(np.median(np.arccos(np.clip(cosine, -1, 1))))))
    return errors[0], errors[1]


def turned_about_up(times_ns: NDArray[np.int64], rates: Array, forces: Array, at_ns: NDArray[np.int64]) -> Array:
    """Returns the rotation about the vertical since the first sample (M,) [rad], at times (M,): the integral of the
    rate along the specific force, averaged over a second."""
    count = max(1, round(1e9 / float(np.median(np.diff(times_ns)))))
    sums = np.vstack([np.zeros((1, 3)), np.cumsum(forces, axis=0)])
    index = np.arange(len(forces))
    first, last = np.maximum(index - count // 2, 0), np.minimum(index + count // 2 + 1, len(forces))
    up = (sums[last] - sums[first]) / (last - first)[:, None]
    up /= np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-12)
    t, turned = _integrated(times_ns, np.sum(rates * up, axis=1, keepdims=True))
    return np.interp((at_ns - times_ns[0]) * 1e-9, (times_ns - times_ns[0]) * 1e-9, turned[:, 0]) if len(t) else t
