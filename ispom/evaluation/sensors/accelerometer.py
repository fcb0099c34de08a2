"""Compares the accelerometer with the positions of the images: gravity, unit, sign and bias, and the mount.

The difference of the mean velocities over two successive intervals is the integral of the acceleration, weighted by a
triangle. So no position is differentiated twice, and gravity need not be known. Clock and mount are those of the
gyroscope, with their uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ispom.evaluation.audit.samples import Path
from ispom.geometry import Array, Pose, so3_exp, so3_log
from ispom.sensors.imu import BIAS_SIGMA, GRAVITY_M_S2, LONGEST_GAP_S

from .fit import Fit, Problem, fitted, loss

NUMBERS = (
    "bias_x", "bias_y", "bias_z", "mount_x", "mount_y", "mount_z", "log_unit", "gravity_x", "gravity_y", "gravity_z",
    "log_scale",
)  # fmt: skip
"""Bias along the unit's axes [m/s^2]; mount as of the gyroscope; logarithm of the measured force over the true one;
gravity in the world of the images [m/s^2]; logarithm of the metres per unit of the images."""
STEPS = np.array([0.01] * 3 + [1e-3] * 3 + [1e-3] + [0.01] * 3 + [1e-3])
FREE_BIAS = 1.0
"""Standard deviation of a bias that no calibrated unit has [m/s^2]; a bias as large as gravity is another mistake."""
WIDEST = np.array([FREE_BIAS] * 3 + [3.0] * 3 + [10.0] + [100.0] * 3 + [10.0])
KNOWN_SCALE = 0.01
"""Relative standard deviation of the unit of a calibrated pair."""
UNITS = {1.0: "m/s^2", 1 / 9.80665: "g", 100.0: "cm/s^2", 1000.0: "mm/s^2", 1000 / 9.80665: "mg"}
UNIT_OFF, KNOWN_UNIT = 0.15, 0.02
"""Logarithm by which mean forces are off a unit at most, and its standard deviation then: gravity alone does not tell a
unit from a vertical bias, and accelerometers are calibrated to 2 %."""
GRAVITY_SIGMA = 0.03
"""[m/s^2] by which gravity differs from its usual value on Earth."""
INTERVAL_S = 0.4
"""Mean velocities are those over at least this time: an error of 1 cm then is one of 0.1 m/s^2."""
SAMPLES = 24
"""Number of times whose accelerations are summed in each triangle."""
AS_GOOD = 10.0
"""Difference of losses from which on another sign of the forces is better: e^10 times as likely."""
TILT_UPRIGHT = 0.5
"""Standard deviation of up in cameras that a person or a vehicle holds upright [rad]: it only tells up from down."""
MOST = 400


@dataclass(frozen=True, eq=False)
class Speeds:
    """N changes of the velocity between two intervals, and the forces meanwhile."""

    changes: Array
    """(N, 3) [1/s of the unit of the images] of the unit's place, in the world of the images."""
    seconds: Array
    """(N,) over which gravity acts: the area of the triangle."""
    forces: Array
    """(N, K, 3) as measured, with their weights [s] multiplied in."""
    weights: Array
    """(N, K) [s]"""
    rotations: Array
    """(N, K, 3, 3) world_from_rig then."""
    rig_from_imu: Array
    """(3, 3) as stated."""

    def tilt_cost(self, gravity: Array) -> float:
        """Returns the loss of gravity (3,) that is not where the rig's y axis points on average: cameras are held
        upright, more or less."""
        down = self.rotations[:, :, :, 1].mean(axis=(0, 1))
        cosine = float(gravity @ down / max(float(np.linalg.norm(gravity) * np.linalg.norm(down)), 1e-12))
        return 0.5 * (float(np.arccos(np.clip(cosine, -1, 1))) / TILT_UPRIGHT) ** 2

    def residuals(self, values: Array) -> Array:
        """Returns (N, 3) [unit of the images per s]."""
        bias, mount, log_unit, gravity, log_scale = values[:3], values[3:6], values[6], values[7:10], values[10]
        scaled = np.exp(-log_unit) * self.forces - self.weights[:, :, None] * bias
        in_rig = scaled @ (so3_exp(mount) @ self.rig_from_imu).T
        made = np.einsum("nkij,nkj->ni", self.rotations, in_rig) + self.seconds[:, None] * gravity
        # The changes are noisier than the forces, and a scale of what is noisy would be too small.
        return np.asarray(self.changes - np.exp(-log_scale) * made)


def speeds(path: Path, times_s: Array, forces: Array, rig_from_imu: Pose, late_s: float) -> Speeds | None:
    """Returns the changes of velocity along a path with rotations; None where there are too few."""
    stride = max(1, round(INTERVAL_S / max(path.interval_s, 1e-6)))
    middle = np.arange(stride, len(path) - stride, max(1, stride // 2))
    middle = middle[:: -(-len(middle) // MOST) or 1].astype(np.intp)
    first, last = middle - stride, middle + stride
    t0, t1, t2 = (path.times_s[i] for i in (first, middle, last))
    gaps = np.append(0, np.cumsum(np.diff(times_s) > LONGEST_GAP_S))
    ends = [np.interp(t + late_s, times_s, gaps, left=-1, right=-1) for t in (t0, t2)]
    good = (ends[0] == ends[1]) & (ends[0] == np.rint(ends[0])) & (ends[0] >= 0)
    good &= t2 - t0 <= 2.5 * np.median(t2 - t0) if len(middle) else good
    if good.sum() < 20 or path.rotations is None:
        return None
    middle, first, last = middle[good], first[good], last[good]
    t0, t1, t2 = t0[good], t1[good], t2[good]
    place = path.positions + path.rotations @ rig_from_imu.translation
    before, after = t1 - t0, t2 - t1
    changes = (place[last] - place[middle]) / after[:, None] - (place[middle] - place[first]) / before[:, None]
    share = (np.arange(SAMPLES) + 0.5) / SAMPLES
    part = (t2 - t0)[:, None] / SAMPLES
    at = t0[:, None] + (t2 - t0)[:, None] * share
    weights = np.minimum((at - t0[:, None]) / before[:, None], (t2[:, None] - at) / after[:, None]) * part
    steps = np.diff(times_s)[:, None] * (forces[1:] + forces[:-1]) / 2
    sums = np.vstack([np.zeros((1, 3)), np.cumsum(steps, axis=0)])

    def summed(t: Array) -> Array:
        return np.stack([np.interp(t + late_s, times_s, column) for column in sums.T], axis=-1)

    mean = (summed(at + part / 2) - summed(at - part / 2)) / part[..., None]
    rotations = path.rotations_at(at.ravel())
    assert rotations is not None
    turned = rotations.reshape(*at.shape, 3, 3)
    return Speeds(changes, weights.sum(axis=1), mean * weights[..., None], weights, turned, rig_from_imu.rotation)


@dataclass(frozen=True, eq=False)
class AccelerometerFit:
    """The numbers (`NUMBERS`) that fit best."""

    fit: Fit
    reversed: bool
    """Whether the forces fit only with their signs reversed."""
    sign_known: bool
    """Whether the motion determines the sign."""


def accelerometer_fit(seen: Speeds, metric: bool, mount: tuple[Array, Array], hidden: Array) -> AccelerometerFit:
    """Returns the fit: with a bias as calibrated units have it, and a free unit; or with a larger bias and the right
    unit, where this is likelier. Gravity alone does not tell the two from each other.

    Args:
        seen: the changes of velocity.
        metric: whether the unit of the images is the metre.
        mount: what the gyroscope knows of it, a rotation vector (3,) and its information (3, 3).
        hidden: axes (K, 3) about which it knows nothing; the forces may show a mount that is turned by quarter turns.
    """
    widest = WIDEST.copy()
    widest[:3] = BIAS_SIGMA[0]
    widest[10] = KNOWN_SCALE if metric else WIDEST[10]
    signs = [_best(_signed(seen, sign), metric, mount, hidden, widest) for sign in (1.0, -1.0)]
    losses = _losses(signs, seen)
    sign_known, reverse = abs(losses[0] - losses[1]) > AS_GOOD, losses[0] - losses[1] > AS_GOOD
    chosen = signs[int(reverse)]
    widest = widest.copy()
    widest[:3], widest[6] = FREE_BIAS, KNOWN_UNIT
    free = _best(_signed(seen, -1.0 if reverse else 1.0), metric, mount, hidden, widest)
    losses = _losses([chosen, free], seen)
    return AccelerometerFit(free if losses[0] - losses[1] > AS_GOOD else chosen, reverse, sign_known)


def _signed(seen: Speeds, sign: float) -> Speeds:
    return replace(seen, forces=sign * seen.forces)


def _best(seen: Speeds, metric: bool, mount: tuple[Array, Array], hidden: Array, widest: Array) -> Fit:
    """Returns the fit with the forces as they are, of several mounts the smallest one that is as good."""
    turns = [mount[0]]
    for axis in hidden:
        turns += [so3_log(so3_exp(angle * axis) @ so3_exp(mount[0])) for angle in (np.pi / 2, -np.pi / 2, np.pi)]
    fits = [_from(seen, metric, (turn, mount[1]), widest) for turn in turns]
    losses = _losses(fits, seen)
    return next(fit for fit, each in zip(fits, losses, strict=True) if each <= min(losses) + AS_GOOD)


def _losses(fits: list[Fit], seen: Speeds) -> list[float]:
    """Returns the losses of fits, with the same noise and including their priors."""
    scale = np.min([fit.scale for fit in fits], axis=0)
    return [
        loss(fit.problem.residuals(fit.values) / scale)
        + fit.problem.prior(fit.values)[2]
        + seen.tilt_cost(fit.values[7:10])
        for fit in fits
    ]


def _from(seen: Speeds, metric: bool, mount: tuple[Array, Array], widest: Array) -> Fit:
    known, information, start = np.zeros(11), np.zeros((11, 11)), np.zeros(11)
    known[3:6], information[3:6, 3:6] = mount
    start[3:6] = mount[0]
    gravity = _first_gravity(seen, so3_exp(mount[0]))
    strength = max(float(np.linalg.norm(gravity)), 1e-9)
    if widest[6] > KNOWN_UNIT:
        start[6] = _log_unit(strength / GRAVITY_M_S2)
        near = any(start[6] == np.log(unit) for unit in UNITS)
        known[6], information[6, 6] = start[6], KNOWN_UNIT**-2 if near else 0.0
    start[7:10] = gravity * GRAVITY_M_S2 / strength
    if not metric:
        start[10] = _first_scale(seen, start)
    return fitted(_with_gravity(seen, widest, known, information, start[7:10]), start)


def _log_unit(ratio: float) -> float:
    """Returns the logarithm of the unit that the strength of gravity is that of; of the ratio itself where none is."""
    near = min(UNITS, key=lambda unit: abs(np.log(ratio / unit)))
    return float(np.log(near if abs(np.log(ratio / near)) < UNIT_OFF else ratio))


def _first_gravity(seen: Speeds, mount: Array) -> Array:
    """Returns gravity (3,) in the unit of the forces, which cancel it on average."""
    made = np.einsum("nkij,jl,nkl->ni", seen.rotations, mount @ seen.rig_from_imu, seen.forces)
    return np.asarray(-np.median(made / seen.seconds[:, None], axis=0))


def _first_scale(seen: Speeds, start: Array) -> float:
    """Returns the logarithm of the scale that fits the forces with this gravity."""
    onto = so3_exp(start[3:6]) @ seen.rig_from_imu
    still = np.einsum("nkij,jl,nkl->ni", seen.rotations, onto, np.exp(-start[6]) * seen.forces)
    made = still + seen.seconds[:, None] * start[7:10]
    ratio = float((made * seen.changes).sum() / max(float((seen.changes**2).sum()), 1e-300))
    return float(np.log(max(ratio, 1e-6)))


def _with_gravity(seen: Speeds, widest: Array, known: Array, information: Array, gravity: Array) -> Problem:
    """Adds that gravity has its usual strength, to first order about a start."""
    up = gravity / np.linalg.norm(gravity)
    strong = np.outer(up, up) / GRAVITY_SIGMA**2
    information = information.copy()
    information[7:10, 7:10] += strong
    known = known.copy()
    known[7:10] = GRAVITY_M_S2 * up
    return Problem(seen.residuals, STEPS, widest, (known, information))
