"""Errors at some time: pairs that the images deny, steps of the scale, and rest in the images or the poses only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from ispom.geometry import Array
from ispom.types import Trajectory

from .evidence import TripleEvidence, relative
from .misfit import Pairs, misfit
from .pairs import BIAS_PX, denies

ALARM = 1e-4
"""Probability of a false alarm of a whole recording by each of the tests, where tracks are as noisy as is assumed."""
LEAST_PAIRS = 2
"""Pairs (or triples) that must deny a motion together: one alone may be a wrong fit."""
QUIET = 0.3
"""Share of the triples from which the scatter of a right scale is computed, because a step is in many triples of a
short recording."""
STILL_PX = 4 * BIAS_PX
"""Images that move by less stand still; poses whose motion should move them by REST_RATIO times as much do not."""
REST_RATIO = 5.0

Local = Literal["motion", "scale", "rest"]


@dataclass(frozen=True)
class Denied:
    """Frames whose poses the images deny."""

    kind: Local
    first: int
    last: int
    """Numbers among the frames of the main camera."""
    size: float
    """motion: largest misfit [standard deviations]; scale: logarithm of the step; rest: displacement [px]."""
    sigma: float
    """Standard deviation of the logarithm of a scale; 0 for the others."""
    turn_rad: float = 0.0
    direction_rad: float = 0.0
    """Misfits of the worst pair, for `motion`."""
    poses_rest: bool = False
    """For `rest`: whether the poses stand still while the images move; otherwise the images stand still."""
    within: tuple[int, int] | None = None
    """For `motion`: frames that all denied pairs contain, where there are any; a jump is between these."""


def denied_motion(pairs: Pairs, given: Trajectory) -> list[Denied]:
    """Returns where several pairs deny the poses."""
    if not len(pairs):
        return []
    found, far = misfit(pairs, given), _far(pairs, given)
    bad = far & _off_lines(pairs, given, far)
    made = []
    for group in groups(pairs.first, pairs.second, bad):
        worst = group[int(np.argmax(found.squares[group]))]
        turn, direction = np.linalg.norm(found.vectors[worst, :3]), np.linalg.norm(found.vectors[worst, 3:])
        first, last = pairs.first[group], pairs.second[group]
        size = float(np.sqrt(found.squares[worst]))
        made.append(
            Denied(
                "motion", int(first.min()), int(last.max()), size, 0.0, float(turn), float(direction),
                within=_common(first, last),
            )
        )  # fmt: skip
    return made


def _far(pairs: Pairs, given: Trajectory) -> NDArray[np.bool_]:
    """Checks which of the pairs (N,) have a fit that is significantly far from the given poses."""
    found = misfit(pairs, given)
    return found.squares > chi2.isf(ALARM / max(len(pairs), 1), found.freedom)


def _off_lines(pairs: Pairs, given: Trajectory, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return np.array([c and denies(p, relative(given, p)) for c, p in zip(chosen, pairs.listed, strict=True)], bool)


def ambiguous(pairs: Pairs, given: Trajectory) -> set[tuple[int, int]]:
    """Returns the pairs, by their frames, whose images the given poses explain as well as another motion does, such as
    those of a plane: the distances of their fits say nothing of the given poses."""
    far = _far(pairs, given)
    other = far & ~_off_lines(pairs, given, far)
    return {(int(pairs.first[n]), int(pairs.second[n])) for n in np.flatnonzero(other)}


def scale_changes(triples: Sequence[TripleEvidence], given: Trajectory) -> tuple[Array, Array]:
    """Returns the logarithms (M,) of the scale's change from before to after each triple's middle, positive where the
    poses grow, and their standard deviations."""
    frames = np.array([each.frames for each in triples], np.int64).reshape(-1, 3)
    steps = np.linalg.norm(np.diff(given.translations[frames], axis=1), axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        changes = np.log(steps[:, 1] / steps[:, 0]) - np.array([each.log_ratio for each in triples])
    return np.where((steps > 0).all(axis=1), changes, np.nan), np.array([each.sigma for each in triples])


def denied_scale(triples: Sequence[TripleEvidence], given: Trajectory) -> list[Denied]:
    """Returns where several triples deny that the poses keep their scale."""
    changes, sigmas = scale_changes(triples, given)
    known = np.isfinite(changes)
    if known.sum() < 2 * LEAST_PAIRS:
        return []
    scatter = np.quantile(np.abs(changes[known] / sigmas[known]), QUIET)
    spread = max(1.0, float(scatter / norm.isf((1 - QUIET) / 2)))
    bad = known & (np.abs(changes) > spread * sigmas * norm.isf(ALARM / 2 / known.sum()))
    first, last = (np.array([each.frames[k] for each in triples]) for k in (0, 2))
    made = []
    for group in groups(first, last, bad):
        worst = group[int(np.argmax(np.abs(changes[group]) / sigmas[group]))]
        middle = triples[worst].frames
        made.append(Denied("scale", middle[0], middle[2], float(changes[worst]), float(spread * sigmas[worst])))
    return made


def denied_rest(pairs: Pairs, given: Trajectory) -> list[Denied]:
    """Returns where either the images or the poses stand still, and the other does not."""
    if not len(pairs):
        return []
    found = misfit(pairs, given)
    motion, parallax = (np.array([getattr(p, name) for p in pairs.listed]) for name in ("motion_px", "parallax_px"))
    turn_px = np.linalg.norm(found.vectors[:, :3], axis=1) / pairs.listed[0].pixel
    moving = found.directed & (parallax > STILL_PX)
    poses_rest = pairs.moves & ~found.directed
    made = [_rest(pairs, group, parallax, True) for group in groups(pairs.first, pairs.second, poses_rest)]
    if moving.sum() >= 10 * LEAST_PAIRS:
        per_length = np.quantile(parallax[moving] / found.lengths[moving], 0.1)  # of the farthest scenes seen
        expected = np.hypot(per_length * found.lengths, turn_px)
        images_rest = (motion < STILL_PX) & (expected > REST_RATIO * STILL_PX)
        made += [_rest(pairs, group, expected, False) for group in groups(pairs.first, pairs.second, images_rest)]
    return made


def _rest(pairs: Pairs, group: NDArray[np.int64], px: Array, poses_rest: bool) -> Denied:
    first, last = int(pairs.first[group].min()), int(pairs.second[group].max())
    return Denied("rest", first, last, float(px[group].max()), 0.0, poses_rest=poses_rest)


def groups(first: NDArray[np.int64], last: NDArray[np.int64], bad: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Returns the places of bad spans of frames that overlap, as groups of at least LEAST_PAIRS, in order of time."""
    made: list[list[int]] = []
    end = -1
    for place in np.flatnonzero(bad)[np.argsort(first[bad], kind="stable")]:
        if first[place] >= end:
            made.append([])
        made[-1].append(int(place))
        end = max(end, int(last[place]))
    return [np.array(group) for group in made if len(group) >= LEAST_PAIRS]


def _common(first: NDArray[np.int64], last: NDArray[np.int64]) -> tuple[int, int] | None:
    """Returns the frames that all of the spans contain; None where there are none."""
    latest, earliest = int(first.max()), int(last.min())
    return (latest, earliest) if latest < earliest else None
