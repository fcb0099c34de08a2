"""Errors of all poses at once: clock, axes, mount, lever arm, inverse poses, or a drift. Each hypothesis is fitted to
one half of the pairs and tested on the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import norm

from ispom.geometry import Array
from ispom.types import Trajectory

from .evidence import TripleEvidence, relative
from .local import QUIET, scale_changes
from .misfit import Pairs, misfit
from .pairs import BIAS_PX, LEAST, UNKNOWN, off_lines_px
from .poses import UNCHANGED, Change, changed, turned

Kind = Literal["clock", "mount", "lever", "axes", "inverse", "turning", "growing"]
CAP = 15.0
"""Squared misfit of a pair at which the robust loss begins to level off: 1 % of right pairs have more."""
GAIN = 10.0
"""A hypothesis must lower the robust cost of each half that did not choose it by more: a likelihood ratio of 150."""
SIGNIFICANT = 4.0
"""Standard deviations from zero at which a clock offset, mount or lever arm is one: 1 in 16,000 by chance."""
MEDIAN_OF_SQUARES = 4.35
"""Median of the chi-squared distribution of 5 degrees of freedom."""
LARGEST_CLOCK_S, CLOCK_STEP_S = 0.5, 0.01
"""Offsets that are tried, and their step; the best one is refined."""
CLOCK_FLOOR_S = 0.002
"""A clock is never known better: cameras stamp the begin, the middle or the end of an exposure of some ms."""
CENTRE_PX = 1.0
"""Usual uncertainty of the principal point of a calibration. A mount is never known better than that."""
CLOCK_TELLS_S, MOUNT_TELLS, LEVER_TELLS = 0.01, np.radians(1.0), 0.5
"""The smallest offsets that matter: half a frame at 50 Hz, a degree [rad], and half of the distance between the frames
of a pair. The images decide about a hypothesis if such an offset would be significant."""
TURNING_TELLS, GROWING_TELLS = np.radians(1.0), 0.1
"""The smallest drifts that matter: 1 degree [rad] in a second, and a tenth of the scale in a second."""
LEAST_EXCHANGE = np.radians(45.0)
"""Exchanged axes turn by at least 90 degrees: a smaller turn is a mount."""
LEAST_TRIPLES = 20
"""Triples from which a change of the scale in time is fitted: as many as pairs that a verdict needs."""
MEDIAN_COSTS = 1.2533
"""Standard deviation of a median over that of a mean, of a normal distribution: the square root of pi / 2."""
BLOCK = 16
"""Frames of a block: the halves are the even and the odd blocks, so that pairs of both are hardly the same motion."""


@dataclass(frozen=True, eq=False)
class Tested:
    """A hypothesis and its test."""

    kind: Kind
    change: Change
    """The change that the whole recording chooses, on top of those that were accepted before."""
    size: float
    """Offset [s], angle of the mount [rad], lever arm [the poses' unit], or drift [rad/s, 1/s]; 0 for an inverse."""
    sigma: float
    """Standard deviation of the size, in its worst direction; 0 for `axes` and `inverse`."""
    telling: float
    """The smallest offset that matters."""
    gains: tuple[float, float]
    """Robust cost that each half's fit saves on the other half."""
    matches_agree: bool = True
    """Whether matches of features fit the poses better with the change than without."""

    @property
    def accepted(self) -> bool:
        """Whether both halves of the tracks confirm it, and the matches."""
        if not self.matches_agree:
            return False
        if (self.kind == "axes" and self.size < LEAST_EXCHANGE) or (
            self.kind == "mount" and self.size > LEAST_EXCHANGE
        ):
            return False
        return min(self.gains) > GAIN and abs(self.size) >= SIGNIFICANT * self.sigma

    @property
    def detectable(self) -> bool:
        """Whether the motion would show an offset that matters."""
        return SIGNIFICANT * self.sigma <= self.telling


@dataclass(frozen=True, eq=False)
class Setting:
    """The poses and the evidence on which hypotheses are tested."""

    pairs: Pairs
    poses: Trajectory
    """world_from_frame, as the file states them."""
    times_ns: NDArray[np.int64]
    """(F,) of the frames."""
    change: Change = UNCHANGED
    """The change by hypotheses that were accepted before."""
    triples: tuple[TripleEvidence, ...] = ()
    """Triples, which show how the scale changes."""

    def residuals(self, change: Change, chosen: NDArray[np.bool_]) -> Array:
        """Returns the robust residuals (5 N,) of some of the pairs: their sum of squares is the cost."""
        pairs = self.pairs.select(chosen)
        white = misfit(pairs, changed(self.poses, self.times_ns, change)).white
        squares = (white**2).sum(axis=1)
        robust = CAP * np.log1p(squares / CAP) / np.maximum(squares, 1e-12)
        return (white * np.sqrt(robust * pairs.share)[:, None]).ravel()

    def cost(self, change: Change, chosen: NDArray[np.bool_]) -> float:
        """Returns the robust cost of some of the pairs."""
        return float((self.residuals(change, chosen) ** 2).sum())

    def dispersion(self, change: Change, chosen: NDArray[np.bool_]) -> float:
        """Returns the median of the squared misfits over the one of pure noise."""
        squares = misfit(self.pairs.select(chosen), changed(self.poses, self.times_ns, change)).squares
        return float(np.median(squares)) / MEDIAN_OF_SQUARES

    def confirmed(self, change: Change) -> bool:
        """Checks whether the matches of most pairs lie nearer to their epipolar lines with a change than without it;
        true where no pair has matches, or none is moved by it."""
        before, after = self.given, changed(self.poses, self.times_ns, change)
        better = worse = 0
        for pair in self.pairs.listed:
            if pair.matches is None or len(pair.matches.x1) < LEAST:
                continue
            poses = relative(before, pair), relative(after, pair)
            if min(np.linalg.norm(pose.translation) for pose in poses) == 0:
                continue
            was, now = (off_lines_px(pair.matches, pose) for pose in poses)
            better, worse = better + (now < was), worse + (now > was)
        return better >= worse

    @property
    def given(self) -> Trajectory:
        """The poses world_from_camera of the frames, as far as is known."""
        return changed(self.poses, self.times_ns, self.change)

    @property
    def halves(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """(N,) each."""
        even = (self.pairs.first // BLOCK) % 2 == 0
        return even, ~even


def tested_all(setting: Setting) -> tuple[tuple[Tested, ...], Change]:
    """Returns the tested hypotheses, the accepted ones first, and the change of all poses by the accepted ones."""
    accepted: list[Tested] = []
    left: list[Kind] = list(TESTS)
    while True:
        tests = [TESTS[kind](setting) for kind in left]
        tests = [replace(t, matches_agree=setting.confirmed(t.change)) if t.accepted else t for t in tests]
        good = [each for each in tests if each.accepted]
        if not good:
            return (*accepted, *tests), setting.change
        best = max(good, key=lambda each: sum(each.gains))
        accepted.append(best)
        setting = replace(setting, change=best.change)
        left = [kind for kind in left if kind not in SETTLES[best.kind]]


def _clock(setting: Setting) -> Tested:
    def of(change: Change, p: Array) -> Change:
        return replace(change, clock_s=change.clock_s + float(p[0]))

    duration_s = float(setting.times_ns[-1] - setting.times_ns[0]) * 1e-9
    largest = min(LARGEST_CLOCK_S, duration_s / 8)
    steps = int(largest / CLOCK_STEP_S)
    starts = [np.array([k * CLOCK_STEP_S]) for k in range(-steps, steps + 1)]
    tested, p, covariance = _fitted(setting, "clock", of, starts)
    sigma = float(np.hypot(np.sqrt(covariance[0, 0]), CLOCK_FLOOR_S))
    return replace(tested, size=float(p[0]), sigma=sigma, telling=CLOCK_TELLS_S)


def _mount(setting: Setting) -> Tested:
    tested, p, covariance = _fitted(setting, "mount", _turned_mount, [np.zeros(3)])
    centre = CENTRE_PX * setting.pairs.listed[0].pixel
    size = float(np.linalg.norm(p))
    return replace(tested, size=size, sigma=float(np.hypot(_sigma(p, covariance), centre)), telling=MOUNT_TELLS)


def _lever(setting: Setting) -> Tested:
    unit = float(np.median(misfit(setting.pairs, setting.given).lengths)) or 1.0

    def of(change: Change, p: Array) -> Change:
        return replace(change, lever=unit * p + (0.0 if change.lever is None else change.lever))

    tested, p, covariance = _fitted(setting, "lever", of, [np.zeros(3)])
    size, sigma = unit * float(np.linalg.norm(p)), unit * _sigma(p, covariance)
    return replace(tested, size=size, sigma=sigma, telling=LEVER_TELLS * unit)


def _turning(setting: Setting) -> Tested:
    def of(change: Change, p: Array) -> Change:
        return replace(change, turning=p + (0.0 if change.turning is None else change.turning))

    tested, p, covariance = _fitted(setting, "turning", of, [np.zeros(3)])
    floor = _bias_per_second(setting)
    size = float(np.linalg.norm(p))
    return replace(tested, size=size, sigma=float(np.hypot(_sigma(p, covariance), floor)), telling=TURNING_TELLS)


def _bias_per_second(setting: Setting) -> float:
    """Returns the rotation rate [rad/s] by which an error of the lens model may turn the camera in every pair."""
    pairs = setting.pairs
    seconds = (setting.times_ns[pairs.second] - setting.times_ns[pairs.first]) * 1e-9
    return float(np.median(BIAS_PX * pairs.listed[0].pixel / np.maximum(seconds, 1e-9)))


def _growing(setting: Setting) -> Tested:
    """Tests a drift of the scale by the triples alone, because relative poses of pairs have no scale."""
    nothing = Tested("growing", setting.change, 0.0, np.inf, GROWING_TELLS, (0.0, 0.0))
    changes, sigmas = scale_changes(setting.triples, setting.given)
    known = np.isfinite(changes)
    if known.sum() < LEAST_TRIPLES:
        return nothing
    frames = np.array([each.frames for each in setting.triples], np.int64)[known]
    seconds = (setting.times_ns[frames[:, 2]] - setting.times_ns[frames[:, 0]]) * 1e-9 / 2
    changes, sigmas, share = changes[known], sigmas[known], 1 / (frames[:, 2] - frames[:, 0])
    even = (frames[:, 0] // BLOCK) % 2 == 0

    def fitted(half: NDArray[np.bool_]) -> float:
        ratio, weight = -changes[half] / seconds[half], (share * (seconds / sigmas) ** 2)[half]
        order = np.argsort(ratio)
        middle = np.searchsorted(np.cumsum(weight[order]), weight.sum() / 2)
        return float(ratio[order][min(int(middle), len(order) - 1)]) if len(order) else 0.0

    rate = fitted(np.ones(len(changes), bool))
    left = np.abs(changes + rate * seconds) / sigmas
    sigmas = sigmas * max(1.0, float(np.quantile(left, QUIET) / norm.isf((1 - QUIET) / 2)))

    def cost(rate: float, half: NDArray[np.bool_]) -> float:
        squares = ((changes + rate * seconds) / sigmas)[half] ** 2
        return float((CAP * np.log1p(squares / CAP) * share[half]).sum())

    gains = [cost(0.0, ~half) - cost(fitted(half), ~half) for half in (even, ~even)]
    sigma = float(MEDIAN_COSTS / np.sqrt((share * (seconds / sigmas) ** 2).sum()))
    change = replace(setting.change, growing=setting.change.growing + rate)
    return Tested("growing", change, rate, sigma, GROWING_TELLS, (gains[0], gains[1]))


def _axes(setting: Setting) -> Tested:
    return _exchanged(setting, "axes", False)


def _inverse(setting: Setting) -> Tested:
    return _exchanged(setting, "inverse", True)


def _exchanged(setting: Setting, kind: Kind, inverse: bool) -> Tested:
    """Tries every exchange of axes, with the poses as they are or inverted."""
    if inverse:
        setting = replace(setting, change=replace(setting.change, inverse=not setting.change.inverse))
    gains, changes = [], []
    original = replace(setting.change, inverse=setting.change.inverse != inverse)
    for half in (*setting.halves, np.ones(len(setting.pairs), bool)):
        starts = [_with_axes(setting.change, axes) for axes in exchanges(with_same=inverse)]
        change = min(starts, key=lambda each: setting.cost(each, half))
        refined = _refined(setting, change, _turned_mount, np.zeros(3), half)[0]
        if setting.cost(change, half) - setting.cost(refined, half) > GAIN:
            change = refined  # else the exchange alone is as good
        changes.append(change)
        gains.append(setting.cost(original, ~half) - setting.cost(change, ~half))
    mount = changes[-1].mount
    size = 0.0 if mount is None else float(np.arccos(np.clip((np.trace(mount) - 1) / 2, -1, 1)))
    return Tested(kind, changes[-1], size, 0.0, 0.0, (gains[0], gains[1]))


def exchanges(with_same: bool) -> Iterator[Array]:
    """Yields the rotations (3, 3) by which axes are exchanged, 24 with the identity."""
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        axes = np.diag(signs)[list(order)]
        if np.linalg.det(axes) > 0 and (with_same or not np.array_equal(axes, np.eye(3))):
            yield axes


def _with_axes(change: Change, axes: Array) -> Change:
    """Returns it with the axes of the poses' frame exchanged, in which the camera stands."""
    mount = axes if change.mount is None else axes @ change.mount
    return replace(change, mount=mount, lever=None if change.lever is None else axes @ change.lever)


def _turned_mount(change: Change, p: Array) -> Change:
    return replace(change, mount=(np.eye(3) if change.mount is None else change.mount) @ turned(p))


Parameters = Callable[[Change, Array], Change]


def _fitted(setting: Setting, kind: Kind, of: Parameters, starts: list[Array]) -> tuple[Tested, Array, Array]:
    """Fits parameters to each half and to the whole; returns the test, and the whole's parameters and covariance."""
    everything, gains = np.ones(len(setting.pairs), bool), []
    for half in (*setting.halves, everything):
        costs = [setting.cost(of(setting.change, p), half) for p in starts]
        change, p, covariance = _refined(setting, setting.change, of, starts[int(np.argmin(costs))], half)
        gains.append(setting.cost(setting.change, ~half) - setting.cost(change, ~half))
    return Tested(kind, change, 0.0, 0.0, 0.0, (gains[0], gains[1])), p, covariance


def _refined(
    setting: Setting, change: Change, of: Parameters, start: Array, chosen: NDArray[np.bool_]
) -> tuple[Change, Array, Array]:
    if not chosen.any():
        return change, start, np.full((len(start), len(start)), np.inf)
    found = least_squares(
        lambda p: setting.residuals(of(change, p), chosen), start, diff_step=1e-4, x_scale=0.01, max_nfev=20
    )
    best = of(change, found.x)
    dispersion = max(1.0, setting.dispersion(best, chosen))
    prior = np.eye(len(start)) / UNKNOWN**2  # where nothing is seen, the covariance stays finite
    return best, found.x, dispersion * np.linalg.inv(found.jac.T @ found.jac + prior)


def _sigma(p: Array, covariance: Array) -> float:
    """The standard deviation in the direction of p where p is significant there, else the largest one."""
    length = float(np.linalg.norm(p))
    along = float(np.sqrt(p @ covariance @ p)) / length if length > 0 else np.inf
    worst = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
    return along if length > SIGNIFICANT * along else worst


TESTS: dict[Kind, Callable[[Setting], Tested]] = {
    "clock": _clock, "mount": _mount, "lever": _lever, "axes": _axes, "inverse": _inverse,
    "turning": _turning, "growing": _growing,
}  # fmt: skip
SETTLES: dict[Kind, tuple[Kind, ...]] = {
    "clock": ("clock",),
    "mount": ("mount", "axes", "inverse"),
    "lever": ("lever",),
    "axes": ("axes", "mount", "inverse"),
    "inverse": ("axes", "mount", "inverse"),
    "turning": ("turning",),
    "growing": ("growing",),
}
"""By accepted hypothesis: those that are not tested any more. All but the clock and the lever arm also turn the
mount."""
