"""The evidence of a whole recording: pairs of frames, and how the distances between three frames compare."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.numerics.robust import normalised_mad
from ispom.solvers.multiview.triangulation import triangulate
from ispom.types import Sequence, Trajectory

from .pairs import BIAS_PX, LEAST, PairEvidence, TwoViews, pair_evidence
from .shake import Shakes, shakes_of
from .tracks import LONGEST_SPAN, Chunk, chunks

SPANS = (2, 4, 8, LONGEST_SPAN)
"""Frames from the first of a pair to the second: the first span with enough parallax is taken. No pair is of
neighbours, so that a jump between two frames is seen by at least two pairs."""
ENOUGH_PX = 20.0
"""Parallax at which a longer span is not needed: the direction is then fixed to BIAS_PX / ENOUGH_PX, under a degree."""


@dataclass(frozen=True, eq=False)
class TripleEvidence:
    """The ratio of two distances by their images: |second to third| / |first to second|."""

    frames: tuple[int, int, int]
    """Numbers among the frames of the main camera."""
    log_ratio: float
    sigma: float
    """Standard deviation of the logarithm: scatter of the points, and a common displacement of BIAS_PX."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """The evidence of the images."""

    pairs: tuple[PairEvidence, ...]
    triples: tuple[TripleEvidence, ...]
    shakes: tuple[Shakes, ...] = ()


def gathered(
    sequence: Sequence, places: NDArray[np.int64], given: Trajectory, covered: NDArray[np.bool_],
    advance: Callable[[], None] = lambda: None,
) -> Evidence:  # fmt: skip
    """Tracks the recording. `given` has the poses world_from_camera of the F frames at these places, of which those
    that are `covered` (F,) can be judged."""
    return of_chunks(chunks(sequence, places, advance), given, covered)


def of_chunks(tracked: Iterable[Chunk], given: Trajectory, covered: NDArray[np.bool_]) -> Evidence:
    """Returns the evidence of the tracks of a recording, chunk by chunk."""
    pairs: list[PairEvidence] = []
    triples: list[TripleEvidence] = []
    shakes: list[Shakes] = []
    for chunk in tracked:
        found = of_chunk(chunk, given, covered)
        pairs += [each for each in found.pairs if each.first < chunk.first + chunk.fresh]
        triples += [each for each in found.triples if each.frames[0] < chunk.first + chunk.fresh]
        shakes += found.shakes
    return Evidence(tuple(pairs), tuple(triples), tuple(shakes))


def refitted(evidence: Evidence, given: Trajectory) -> Evidence:
    """Returns the evidence with the pairs fitted again, near poses that are known to be better than those before."""
    pairs = (pair_evidence((p.first, p.second), p.views, relative(given, p), p.matches) for p in evidence.pairs)
    return replace(evidence, pairs=tuple(p for p in pairs if p is not None))


def relative(given: Trajectory, pair: PairEvidence) -> Pose:
    """Returns the given second_from_first of a pair."""
    return given.pose(pair.second).inverse() @ given.pose(pair.first)


def of_chunk(chunk: Chunk, given: Trajectory, covered: NDArray[np.bool_]) -> Evidence:
    """Returns the evidence of one chunk's tracks."""
    pairs = {}
    for f in range(chunk.x.shape[1]):
        pair = _pair_from(chunk, f, given, covered)
        if pair is not None:
            pairs[pair.first] = pair
    triples = (_triple(chunk, pair, pairs[pair.second]) for pair in pairs.values() if pair.second in pairs)
    known = tuple(t for t in triples if t is not None)
    return Evidence(tuple(pairs.values()), known, tuple(shakes_of(chunk, covered)))


def _pair_from(chunk: Chunk, f: int, given: Trajectory, covered: NDArray[np.bool_]) -> PairEvidence | None:
    """The pair of the shortest span with enough parallax that can be fitted; else of the longest one."""
    short: list[int] = []
    for span in SPANS:
        i, j = chunk.first + f, chunk.first + f + span
        if f + span >= chunk.x.shape[1] or not (covered[i] and covered[j]):
            break
        if not _has_enough(chunk.views(f, f + span)):
            short.append(span)
        elif (pair := _fitted(chunk, f, f + span, given)) is not None:
            return pair
    pairs = (_fitted(chunk, f, f + span, given) for span in reversed(short))
    return next((pair for pair in pairs if pair is not None), None)


def _has_enough(views: TwoViews) -> bool:
    return len(views.x1) >= LEAST and views.parallax_px >= ENOUGH_PX


def _fitted(chunk: Chunk, first: int, second: int, given: Trajectory) -> PairEvidence | None:
    ends = chunk.first + first, chunk.first + second
    pair = pair_evidence(ends, chunk.views(first, second), given.pose(ends[1]).inverse() @ given.pose(ends[0]))
    if pair is None or chunk.matches is None:
        return pair
    return replace(pair, matches=chunk.matches(first, second))


def _triple(chunk: Chunk, a: PairEvidence, b: PairEvidence) -> TripleEvidence | None:
    if not (a.moves and b.moves):
        return None
    x = chunk.x[:, [a.first - chunk.first, a.second - chunk.first, b.second - chunk.first]]
    x = x[np.isfinite(x).all(axis=(1, 2))]
    depth_a = Pose(a.rotation, a.direction).apply(triangulate(Pose(a.rotation, a.direction), x[:, 0], x[:, 1]))[:, 2]
    depth_b = triangulate(Pose(b.rotation, b.direction), x[:, 1], x[:, 2])[:, 2]
    good = (depth_a > 0) & (depth_b > 0)
    if good.sum() < LEAST:
        return None
    log_ratio: Array = np.log(depth_a[good] / depth_b[good])
    scatter = normalised_mad(log_ratio) / np.sqrt(good.sum())
    sigma = float(np.hypot(scatter, np.hypot(BIAS_PX / a.parallax_px, BIAS_PX / b.parallax_px)))
    return TripleEvidence((a.first, a.second, b.second), float(np.median(log_ratio)), sigma)
