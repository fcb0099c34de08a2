"""Checks whether both clocks are one: their offset, their rates, the unit of times; for rows, a shifted index.

The offset is searched by the speeds of rotation and of motion, which do not depend on axes. The errors of blocks refine
it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ispom.evaluation.audit.blocks import Errors, errors, groups_of, levels
from ispom.evaluation.audit.correction import Correction
from ispom.evaluation.audit.explanation import (
    SAMPLES_NEEDED,
    SIGNIFICANT,
    Explanation,
    Scene,
    held_out,
    jackknife_sigma,
)
from ispom.evaluation.audit.samples import MAX_SAMPLES, Path, Samples
from ispom.geometry import Array, rotation_angle_rad

MIN_OFFSET_S = 0.01
"""Least offset that is named [s]: the difference with which poses are associated by default."""
MIN_OVERLAP = 0.5
"""Least overlap of both trajectories after a shift, relative to the shorter one: shorter stretches look alike by
chance."""
GRID = 20_000
"""Largest number of samples of the speeds that are correlated."""
PEAKS = 12
"""Number of peaks of the correlation that are tried."""
NEAR = 20
"""Least distance between two peaks, in samples: noise makes several of each."""
OFFSETS = 21
"""Number of offsets in each round of the refinement."""
AS_GOOD = 1.0
"""Difference of the logarithms of errors within which a smaller offset is preferred before both are refined: a wrong
one is worse by a factor of ten and more, as is a right one that is half a sample off."""
ROUNDS = 3
"""Rounds of the refinement, each finer by OFFSETS / 4."""
UNITS = (1e-9, 1e-6, 1e-3, 1e3, 1e6, 1e9)
"""Rates of clocks in another unit."""
UNIT_SPAN = 3.0
"""Largest ratio of the spans of both trajectories once the unit is right."""
MIN_DRIFT = 1e-5
"""Least difference of rates that is named; quartz clocks differ by up to 1e-4."""
MAX_AFTER = 0.3
"""Largest error of positions, relative to a block's extent, with which an offset is believed where there are no common
times to compare with."""


def clock(scene: Scene) -> Iterator[Explanation]:
    """Returns the explanations by an offset, by an offset and a rate, and by another unit of times."""
    if scene.paired:
        return
    for rate in (1.0, *(_unit_rates(scene) if scene.timed else ())):
        scaled = with_rate(scene, rate)
        candidates = offsets(scaled.own, scaled.true)
        if rate == 1.0:
            candidates = [0.0, *candidates]
        best = _least_shifted(scaled, candidates)
        if best is None:
            continue
        found = _offset(scene, rate, best)
        if found is not None:
            yield found
        if rate == 1.0 and scene.timed:
            drift = _drift(scene, best)
            if drift is not None:
                yield drift


def _least_shifted(scene: Scene, offsets_s: list[float]) -> float | None:
    """Returns the smallest of the offsets that are as good as the best one: a motion that repeats itself fits at each
    of its periods. None where none has enough samples."""
    step = 0.5 * max(scene.own.interval_s, scene.true.interval_s)
    tried = []
    for offset in offsets_s:
        near = np.array([offset - step, offset, offset + step]) if scene.timed else np.array([offset])
        costs = np.array([_cost(scene, o) for o in near])
        if not np.isfinite(costs).all():
            continue
        # The offset between two tried ones may be much better than both.
        better = float(near[int(np.argmin(costs))])
        if scene.timed:
            centre = _least(near, costs)
            costs = np.append(costs, _cost(scene, centre))
            better = centre if costs[-1] <= costs[:-1].min() else better
        tried.append((float(costs.min()), better))
    least = min((cost for cost, _ in tried), default=np.inf)
    good = [offset for cost, offset in tried if cost <= least + AS_GOOD]
    return min(good, key=abs, default=None)


def with_rate(scene: Scene, rate: float) -> Scene:
    if rate == 1.0:
        return scene
    first = scene.own.times_s[0]
    own = Path(first + rate * (scene.own.times_s - first), scene.own.rotations, scene.own.positions)
    return Scene(own, scene.true, scene.with_scale, scene.timed)


def _unit_rates(scene: Scene) -> list[float]:
    spans = scene.true.span_s / max(scene.own.span_s, 1e-12)
    return [rate for rate in UNITS if 1 / UNIT_SPAN <= spans / rate <= UNIT_SPAN]


def offsets(own: Path, true: Path) -> list[float]:
    """Returns the offsets [s] to add to the estimate's times at which the speeds of both agree best."""
    step = max(own.interval_s, true.interval_s, (own.span_s + true.span_s) / GRID)
    shorter = min(own.span_s, true.span_s)
    if step <= 0 or shorter / step < SAMPLES_NEEDED / 2:
        return []
    found = []
    signals = [(_speeds(own, step), _speeds(true, step))]
    if own.rotations is not None and true.rotations is not None:
        signals.append((_turn_rates(own, step), _turn_rates(true, step)))
    for mine, theirs in signals:
        correlation, lags = _correlation(mine, theirs, round(MIN_OVERLAP * shorter / step))
        before, after = np.append(-2.0, correlation[:-1]), np.append(correlation[1:], -2.0)
        peaks = np.flatnonzero((correlation > before) & (correlation >= after))
        start = true.times_s[0] - own.times_s[0]
        found += [float(lag * step + start) for lag in _apart(lags[peaks], correlation[peaks], -start / step)]
    return found


def _apart(lags: NDArray[np.int64], correlation: Array, unshifted: float) -> list[float]:
    """Returns the lags of the highest peaks, none next to a higher one, and that of the peak near no shift."""
    near, best = abs(lags - unshifted) <= NEAR, list[float]()
    for i in np.argsort(-correlation, kind="stable"):
        if len(best) == PEAKS:
            break
        if all(abs(lags[i] - other) > NEAR for other in best):
            best.append(float(lags[i]))
    return [*best, float(lags[near][np.argmax(correlation[near])])] if near.any() else best


def _speeds(path: Path, step: float) -> Array:
    times = np.arange(path.times_s[0], path.times_s[-1] + 0.5 * step, step)
    return np.linalg.norm(np.diff(path.positions_at(times), axis=0), axis=1)


def _turn_rates(path: Path, step: float) -> Array:
    times = np.arange(path.times_s[0], path.times_s[-1] + 0.5 * step, step)
    rotations = path.rotations_at(times)
    assert rotations is not None
    return rotation_angle_rad(np.swapaxes(rotations[:-1], 1, 2) @ rotations[1:])


def _correlation(own: Array, true: Array, least: int) -> tuple[Array, NDArray[np.int64]]:
    """Returns Pearson's correlation of two signals for each lag with at least `least` common samples, and the lags.

    Logarithms keep single jumps from deciding.
    """
    a, b = (np.log(x + 0.1 * np.median(x) + 1e-12) for x in (own, true))
    count = len(a) + len(b) - 1
    size = 1 << (count - 1).bit_length()

    def products(x: Array, y: Array) -> Array:
        """Sums over x[i] y[i + lag], for lags from -(len(x) - 1)."""
        spectrum = np.conj(np.fft.rfft(x, size)) * np.fft.rfft(y, size)
        return np.roll(np.fft.irfft(spectrum, size), len(a) - 1)[:count]

    a, b = a - a.mean(), b - b.mean()
    ones = np.ones(len(a)), np.ones(len(b))
    n = np.maximum(np.rint(products(*ones)), 1)
    sums = products(a, ones[1]), products(ones[0], b)
    squares = products(a**2, ones[1]), products(ones[0], b**2)
    spread = [np.maximum(s2 - s1**2 / n, 1e-12 * (s2.max() + 1e-12)) for s1, s2 in zip(sums, squares, strict=True)]
    correlation = (products(a, b) - sums[0] * sums[1] / n) / np.sqrt(spread[0] * spread[1])
    lags = np.arange(count) - (len(a) - 1)
    return np.where(n >= max(least, 1), correlation, -1.0), lags


def _cost(scene: Scene, offset_s: float) -> float:
    """Mean logarithm of the errors of blocks with an offset; infinite with too few samples."""
    samples = scene.samples(offset_s)
    starts = levels(len(samples))
    if not starts:
        return np.inf
    return float(_log_errors(errors(samples, starts[min(1, len(starts) - 1)], scene.with_scale, tied=False)).mean())


def _log_errors(found: Errors) -> Array:
    """(B,) of positions, and of rotations where there are some."""
    turns = 0.0 if found.rotation is None else np.log(found.rotation)
    return np.log(found.position) + turns


def _common(scene: Scene, shifts: list[tuple[float, float]]) -> Array:
    """Returns the estimate's times (N,) that have a partner under each (rate, offset)."""
    own, first = scene.own, scene.own.times_s[0]
    # Samples at the estimate's times, thinned to the lower of both rates.
    count = min(len(own), round(own.span_s / max(own.interval_s, scene.true.interval_s, 1e-12)) + 1)
    times = own.times_s if count >= len(own) else np.linspace(first, own.times_s[-1], count)
    times = times[:: -(-len(times) // MAX_SAMPLES)]
    good = own.inside(times)
    for rate, offset in shifts:
        good &= scene.true.inside(first + rate * (times - first) + offset)
    return times[good]


def _samples(scene: Scene, times_s: Array, rate: float, offset_s: float) -> Samples:
    """Returns samples at the estimate's times; the reference is interpolated."""
    first = scene.own.times_s[0]
    theirs = first + rate * (times_s - first) + offset_s
    return Samples(
        theirs,
        scene.own.positions_at(times_s),
        scene.own.rotations_at(times_s),
        scene.true.positions_at(theirs),
        scene.true.rotations_at(theirs),
    )


def _refined(
    scene: Scene, times_s: Array, rate: float, offset_s: float, starts: NDArray[np.intp]
) -> tuple[float, Array]:
    """Returns the best offset, and those (G,) without each group of blocks, by parabolas through the least costs."""
    group = groups_of(len(starts))
    width = 2 * max(scene.own.interval_s * rate, scene.true.interval_s)
    centre = offset_s
    grid, costs = np.zeros(0), np.zeros((0, 0))
    for _ in range(ROUNDS):
        grid = centre + width * np.linspace(-1, 1, OFFSETS)
        costs = np.array(
            [_log_errors(errors(_samples(scene, times_s, rate, o), starts, scene.with_scale, tied=False)) for o in grid]
        )
        centre = _least(grid, costs.sum(axis=1))
        width *= 4 / OFFSETS
    return centre, np.array([_least(grid, costs[:, group != g].sum(axis=1)) for g in np.unique(group)])


def _least(grid: Array, costs: Array) -> float:
    i = int(np.argmin(costs))
    if i in (0, len(grid) - 1):
        return float(grid[i])
    a, b, c = costs[i - 1 : i + 2]
    bend = a - 2 * b + c
    return float(grid[i] + 0.5 * (grid[1] - grid[0]) * (a - c) / bend) if bend > 0 else float(grid[i])


def _offset(scene: Scene, rate: float, offset_s: float) -> Explanation | None:
    """Returns the explanation by an offset, and a unit of times where `rate` is not 1; None with too few samples."""
    times, compared = _common(scene, [(1.0, 0.0), (rate, offset_s)]), True
    if len(times) < SAMPLES_NEEDED:
        times, compared = _common(scene, [(rate, offset_s)]), False
    if not levels(len(times)):
        return None
    gains, after, fitted, sigmas = [], [], [], []
    for starts in levels(len(times))[:3]:
        if scene.timed:
            best, fits = _refined(scene, times, rate, offset_s, starts)
        else:
            best, fits = float(round(offset_s)), np.full(len(np.unique(groups_of(len(starts)))), float(round(offset_s)))

        def at(offset: Array, starts: NDArray[np.intp] = starts) -> Errors:
            return errors(_samples(scene, times, rate, float(offset[0])), starts, scene.with_scale)

        left = held_out(at, fits[:, None], groups_of(len(starts)))
        if compared:
            gains.append(errors(_samples(scene, times, 1.0, 0.0), starts, scene.with_scale).gain(left))
        else:
            gains.append(np.log(1 / left.position) + np.log(MAX_AFTER))
        after.append(left)
        fitted.append(best)
        sigmas.append(float(jackknife_sigma(fits[:, None])[0]))
    chosen = int(np.argmax([gain.mean() for gain in gains]))
    value, sigma = fitted[chosen], sigmas[chosen]
    values, deviations = {"offset_s": value}, {"offset_s": sigma}
    if rate != 1.0:
        values, deviations = {"clock_rate": rate, **values}, {"clock_rate": 0.0, **deviations}
    least = MIN_OFFSET_S if scene.timed else 0.5
    return Explanation(
        "offset" if rate == 1.0 else "time_unit",
        Correction(offset_s=value, clock_rate=rate),
        tuple(gains),
        tuple(after),
        1,
        values,
        deviations,
        rate != 1.0 or abs(value) >= max(least, SIGNIFICANT * sigma),
    )


def _drift(scene: Scene, offset_s: float) -> Explanation | None:
    """Returns the explanation by an offset that grows evenly, from the offsets of groups of blocks."""
    times = _common(scene, [(1.0, 0.0), (1.0, offset_s)])
    found = levels(len(times))
    if not found:
        return None
    starts = found[min(1, len(found) - 1)]
    group = groups_of(len(starts))
    middles, local = _local_offsets(scene, times, offset_s, starts)
    if len(middles) < 4:
        return None
    since = middles - scene.own.times_s[0]
    fits = np.array([np.polyfit(np.delete(since, g), np.delete(local, g), 1) for g in range(len(since))])
    slope, start = np.polyfit(since, local, 1)

    def at(line: Array) -> Errors:
        return errors(_samples(scene, times, 1 + float(line[0]), float(line[1])), starts, scene.with_scale)

    good = scene.true.inside(scene.own.times_s[0] + (1 + slope) * (times - scene.own.times_s[0]) + start)
    if good.mean() < 1 - MIN_OVERLAP / 2:
        return None
    left = held_out(at, fits, group)
    gain = errors(_samples(scene, times, 1.0, 0.0), starts, scene.with_scale).gain(left)
    sigma = jackknife_sigma(fits)
    # At the other levels it is as good as here: it is one claim, checked once.
    gains = [np.full(len(level), -np.inf) for level in found]
    after = [Errors(np.full(len(level), np.inf), None, None) for level in found]
    k = min(1, len(found) - 1)
    gains[k], after[k] = gain, left
    return Explanation(
        "drift",
        Correction(offset_s=float(start), clock_rate=1 + float(slope)),
        tuple(gains),
        tuple(after),
        2,
        {"clock_rate": 1 + float(slope), "offset_s": float(start)},
        {"clock_rate": float(sigma[0]), "offset_s": float(sigma[1])},
        abs(slope) >= max(MIN_DRIFT, SIGNIFICANT * float(sigma[0])),
    )


def _local_offsets(scene: Scene, times_s: Array, offset_s: float, starts: NDArray[np.intp]) -> tuple[Array, Array]:
    """Returns middle times (G,) of the groups, and the offset (G,) that fits each."""
    group = groups_of(len(starts))
    width = max(1.0, 10 * max(scene.own.interval_s, scene.true.interval_s))
    centres = np.full(len(np.unique(group)), offset_s)
    for _ in range(ROUNDS):
        steps = width * np.linspace(-1, 1, OFFSETS)
        costs = np.zeros((OFFSETS, len(centres)))
        of_block = centres[group]
        of_sample = np.repeat(of_block, np.diff(np.append(starts, len(times_s))))
        for i, step in enumerate(steps):
            theirs = times_s + of_sample + step
            samples = Samples(
                theirs,
                scene.own.positions_at(times_s),
                scene.own.rotations_at(times_s),
                scene.true.positions_at(theirs),
                scene.true.rotations_at(theirs),
            )
            found = _log_errors(errors(samples, starts, scene.with_scale, tied=False))
            costs[i] = np.bincount(group, found)
        centres = np.array([c + _least(steps, costs[:, g]) for g, c in enumerate(centres)])
        width *= 4 / OFFSETS
    counts = np.repeat(group, np.diff(np.append(starts, len(times_s))))
    middles = np.bincount(counts, times_s) / np.bincount(counts)
    return middles, centres
