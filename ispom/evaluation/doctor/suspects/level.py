"""A pair that is not level: its images do not show a point at the height that the calibration predicts.

Each match of the left and the right image has a distance from its epipolar line. This needs no scene and no parallax,
so it works for single pairs, too. For a shifted right image the distance is the same everywhere. For a turned right
camera it is larger at the top and bottom of a wide image (pitch), or at its sides (roll). For a late right image, or a
camera at another height, it is larger for near points.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array

from ..examination import Examination
from ..finding import Finding, Suspect

LEVEL_PX = 0.5
"""Offset, in images of the examined size, from which on a pair is not level: twice the sigma that the estimators
assume of such an offset."""
SURE = 5.0
"""The offset over its standard error, at least."""
LEAST_POINTS = 30
MOST_SPREAD_PX = 1.5
"""Largest scatter of the matches for a finding: with more they are false, or the calibration has other errors."""
CLIP, ROUNDS = 4.0, 3
"""Residual of a match, in standard deviations, from which on it is discarded; number of rounds that discard matches."""
PREFERRED = 9.0
"""Twice the difference of the logarithms of the likelihoods from which on a model is preferred: 3 sigma."""


def unlevel(seen: Examination) -> Finding | None:
    """Measures the vertical displacement of the right image. None where the matches do not determine it."""
    if (measured := offsets(seen)) is None:
        return None
    off, ray, disparity, point, pair = measured
    if len(np.unique(point)) < LEAST_POINTS or np.median(disparity) < 0:
        return None
    x, y = ray.T
    one = np.ones(len(off))
    models = {
        "shift": np.column_stack([one, x]),
        "turn": np.column_stack([1 + y**2, x]),
        "near": np.column_stack([disparity, x]),
    }
    kept = one > 0
    for _ in range(ROUNDS):
        fitted = _fitted(models["shift"], off, kept)
        spread = 1.4826 * float(np.median(np.abs(fitted[kept])))
        kept = np.abs(fitted) < CLIP * max(spread, 1e-3)
    if spread > MOST_SPREAD_PX:
        return None
    points = len(np.unique(point[kept]))
    misfit = {name: points * np.log(float(np.mean(_fitted(m, off, kept)[kept] ** 2))) for name, m in models.items()}
    shift, shown = float(np.median(off[kept])), int(np.median(pair[kept]))
    medians = [float(np.median(off[kept & (pair == q)])) for q in np.unique(pair[kept])]
    scatter = float(np.std(off[kept])) * np.sqrt(np.pi / 2 / points)
    sigma = float(np.hypot(scatter, np.std(medians) / np.sqrt(len(medians))))
    pitch, roll = (float(v) for v in np.linalg.lstsq(models["turn"][kept], off[kept])[0])
    focal, half = seen.rig.camera("right").fx, float(np.percentile(np.abs(x), 95))
    largest = max(abs(shift), abs(roll) * half)
    turned = misfit["turn"] + PREFERRED < misfit["shift"] or largest > abs(shift)
    if largest > LEVEL_PX and misfit["near"] + PREFERRED < misfit["shift"]:
        return None
    shift_px, sigma_px, limit_px = (seen.recorded_px("right", px) for px in (shift, sigma, LEVEL_PX))
    strength = largest / LEVEL_PX if largest > SURE * sigma else min(largest / LEVEL_PX, 0.9)
    text = (
        f"The right image is {abs(shift_px):.2f} px (±{sigma_px:.2f}) too {'low' if shift > 0 else 'high'} by {points} "
        "points"
    )
    degrees = {"pitch_deg": float(np.degrees(pitch / focal)), "roll_deg": float(np.degrees(roll / focal))}
    if turned:
        angles = " and ".join(f"{degrees[k]:+.2f} degrees of {k.removesuffix('_deg')}" for k in degrees)
        text += f", as of a right camera with {angles}"
        if seen.baseline is not None:  # tracks determine all three of its angles: this is another suspect
            strength = min(strength, 0.9)
    else:
        text += ", everywhere by the same"
    return Finding(
        strength,
        f"{text} (a cause from {limit_px:.1f} px on).",
        {"shift_px": shift_px, "shift_px_sigma": sigma_px, **degrees},
        (seen.pairs[shown].index,),
    )


def offsets(seen: Examination) -> tuple[Array, Array, Array, NDArray[np.int64], NDArray[np.int64]] | None:
    """Returns, of all matches of the pairs, the distance (N,) from the epipolar line [px of the right camera], positive
    where the right image shows it too low, the place in the right image (N, 2), normalised, the disparity (N,) [px],
    the point (N,) and the pair (N,)."""
    if not seen.rig.has_stereo or not seen.pairs:
        return None
    point, pair = np.nonzero(np.isfinite(seen.tracked.right[..., 0]))
    if not len(point):
        return None
    left, right = (side[point, pair] for side in (seen.tracked.left, seen.tracked.right))
    cameras = seen.rig.camera("left"), seen.rig.camera("right")
    rays = [np.column_stack([c.normalise(uv), np.ones(len(uv))]) for c, uv in zip(cameras, (left, right), strict=True)]
    right_from_left = seen.rig.rig_from_right.inverse() @ seen.rig.rig_from_left
    lines = np.cross(right_from_left.translation, rays[0] @ right_from_left.rotation.T)
    lines *= np.where(lines[:, 1:2] < 0, -1, 1) / np.linalg.norm(lines[:, :2], axis=1, keepdims=True)
    off = cameras[1].fx * (lines * rays[1]).sum(axis=1)
    return off, rays[1][:, :2], left[:, 0] - right[:, 0], point, pair


def _fitted(model: Array, off: Array, kept: NDArray[np.bool_]) -> Array:
    """Returns the residuals (N,) of all offsets after a fit of a linear model (N, M) to the kept ones."""
    return off - model @ np.linalg.lstsq(model[kept], off[kept])[0]


UNLEVEL = Suspect(
    "unlevel-pair",
    "the stereo pair is not level",
    "images",
    "Calibrate the pair again, or rectify its images again: left and right must show a point in the same row.",
    unlevel,
)
