"""The judgement of a trajectory: errors of all poses, errors at some time, and the verdict."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ispom.types import Trajectory

from .evidence import Evidence, TripleEvidence, refitted
from .hypotheses import Setting, Tested, tested_all
from .local import Denied, ambiguous, denied_motion, denied_rest, denied_scale, scale_changes
from .misfit import Pairs, misfit
from .poses import UNCHANGED, Change, changed, own
from .shake import Smoothing, smoothing

Verdict = Literal["agrees", "contradicted", "cannot tell"]
LEAST_PAIRS = 20
"""Pairs with a motion that a verdict needs: with fewer, each half of them hardly tests a hypothesis."""
STRETCHES = 10
"""Stretches of a recording that are listed, at most; each has at least SHORTEST frames."""
SHORTEST = 16
SURE_TURN, SURE_DIRECTION = np.radians(5.0), np.radians(20.0)
"""Largest median standard deviations [rad] of turns and directions with which agreement means something."""


@dataclass(frozen=True)
class StretchMisfit:
    """Medians over the pairs that begin in a stretch."""

    first: int
    last: int
    """Numbers among the frames of the main camera."""
    pairs: int
    epipolar_px: float
    """Distance of tracks from the epipolar lines of the given poses, RMS, in pixels of the tracked images."""
    fitted_px: float
    """The same with the relative poses that fit the tracks best."""
    turn_deg: float
    turn_sigma_deg: float
    direction_deg: float
    direction_sigma_deg: float
    """NaN where no pair of the stretch fixes it."""
    scale: float
    """Factor by which the poses' scale changes in the stretch; NaN where no triple shows it."""
    scale_sigma: float


@dataclass(frozen=True)
class PairMisfit:
    """The misfit between the poses of two frames and their images."""

    first: int
    second: int
    """Numbers among the frames of the main camera."""
    sigmas: float
    """Standard deviations: the root of the squared misfit over its number of freedom, about 1 of right poses."""


@dataclass(frozen=True, eq=False)
class Judgement:
    """The judgement of a trajectory."""

    verdict: Verdict
    tested: tuple[Tested, ...]
    """Hypotheses about errors of all poses, the accepted ones first."""
    change: Change
    """The change of all poses by the accepted hypotheses."""
    denied: tuple[Denied, ...]
    """Where the images deny the poses, changed by `change`, in order of time."""
    stretches: tuple[StretchMisfit, ...]
    """Stretches of the poses as they were given."""
    pairs: int
    frames: int
    """Number of frames that have a pose."""
    smoothing: Smoothing | None = None
    """The part of the images' shake that the poses lack; None where the images show none."""
    misfits: tuple[PairMisfit, ...] = ()
    """Misfits of the poses as they were given, by first frame. A pair is skipped if its images have two explanations
    and the poses are one of them."""


def judge(
    evidence: Evidence, poses: Trajectory, times_ns: NDArray[np.int64], has_pose: NDArray[np.bool_],
    frame: Change = UNCHANGED,
) -> Judgement:  # fmt: skip
    """Judges poses world_from_frame by the evidence of images at times (F,), of which some have a pose (F,). `frame`
    says how the camera stands in the frame of the poses."""
    pairs = Pairs(evidence.pairs)
    count = int(has_pose.sum())
    if pairs.moves.sum() < LEAST_PAIRS:
        return Judgement("cannot tell", (), frame, (), (), len(pairs), count)
    as_given = changed(poses, times_ns, frame)
    other = ambiguous(pairs, as_given)
    setting = Setting(pairs, poses, times_ns, frame, _clear(evidence, other))
    tested, change = tested_all(setting)
    right = changed(poses, times_ns, change)
    if change is not frame:
        pairs = Pairs(refitted(evidence, right).pairs)
    other = ambiguous(pairs, right)
    denied = [
        *denied_motion(pairs, right),
        *denied_scale(_clear(evidence, other), right),
        *denied_rest(pairs, right),
    ]
    stretches = _stretches(evidence, as_given)
    at_own_time = own(poses, times_ns + round(change.clock_s * 1e9))
    smoothed = smoothing(evidence.shakes, right, at_own_time, pairs.listed[0].pixel)
    if denied or any(each.accepted for each in tested) or (smoothed is not None and smoothed.found):
        verdict: Verdict = "contradicted"
    else:
        verdict = "agrees" if _sure(pairs) else "cannot tell"
    in_time = tuple(sorted(denied, key=lambda each: each.first))
    misfits = _misfits(Pairs(evidence.pairs), as_given)
    return Judgement(verdict, tested, change, in_time, stretches, len(pairs), count, smoothed, misfits)


def _misfits(pairs: Pairs, given: Trajectory) -> tuple[PairMisfit, ...]:
    found, other = misfit(pairs, given), ambiguous(pairs, given)
    sigmas = np.sqrt(found.squares / found.freedom)
    made = (PairMisfit(int(a), int(b), float(s)) for a, b, s in zip(pairs.first, pairs.second, sigmas, strict=True))
    return tuple(sorted((m for m in made if (m.first, m.second) not in other), key=lambda m: m.first))


def _clear(evidence: Evidence, other: set[tuple[int, int]]) -> tuple[TripleEvidence, ...]:
    """The triples without those of ambiguous pairs."""
    return tuple(t for t in evidence.triples if not {t.frames[:2], t.frames[1:]} & other)


def _sure(pairs: Pairs) -> bool:
    turns, directions = _sigmas(pairs)
    return bool(np.median(turns) < SURE_TURN and np.median(directions[pairs.moves]) < SURE_DIRECTION)


def _sigmas(pairs: Pairs) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Standard deviations (N,) [rad] of turns and directions, over their axes."""
    variances = np.diagonal(pairs.covariances, axis1=1, axis2=2)
    return np.sqrt(variances[:, :3].mean(axis=1)), np.sqrt(variances[:, 3:].mean(axis=1))


def _stretches(evidence: Evidence, given: Trajectory) -> tuple[StretchMisfit, ...]:
    pairs = Pairs(evidence.pairs)
    found, (turn_sigmas, direction_sigmas) = misfit(pairs, given), _sigmas(pairs)
    normals = np.array([each.normal for each in pairs.listed])
    pixel, noise = pairs.listed[0].pixel, np.array([each.noise_px for each in pairs.listed])
    added = np.sqrt(np.einsum("ni,nij,nj->n", found.vectors, normals, found.vectors)) / pixel
    turns, directions = (np.degrees(np.linalg.norm(v, axis=1)) for v in np.split(found.vectors, [3], axis=1))
    changes, sigmas = scale_changes(evidence.triples, given)
    middles = np.array([each.frames[1] for each in evidence.triples], np.int64)
    last = int(pairs.second.max())
    edges = np.linspace(pairs.first.min(), last, max(1, min(STRETCHES, last // SHORTEST)) + 1).astype(int)
    made = []
    for a, b in pairwise(edges.tolist()):
        here = (pairs.first >= a) & (pairs.first < b)
        if not here.any():
            continue
        directed = here & found.directed
        shown = np.isfinite(changes) & (middles >= a) & (middles < b)
        made.append(
            StretchMisfit(
                a, b, int(here.sum()),
                float(np.median(np.hypot(noise, added)[here])), float(np.median(noise[here])),
                float(np.median(turns[here])), float(np.degrees(np.median(turn_sigmas[here]))),
                float(np.median(directions[directed])) if directed.any() else np.nan,
                float(np.degrees(np.median(direction_sigmas[directed]))) if directed.any() else np.nan,
                float(np.exp(np.median(changes[shown]))) if shown.any() else np.nan,
                float(np.median(sigmas[shown])) if shown.any() else np.nan,
            )
        )  # fmt: skip
    return tuple(made)
