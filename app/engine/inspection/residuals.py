"""Distributions of reprojection errors: by size, over the image, and by distance from the principal point."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ispom.geometry import Array
from ispom.types import Camera, TrackStatus

from .sightings import Seen

CELLS = (8, 6)
"""Columns and rows over the image."""
RINGS = 8
LEAST = 5
"""Least number of residuals for a median."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of the tracks that took part in the pose and did not end."""

    uv: Array
    """(N, 2) [px]."""
    residual_px: Array
    """(N,)."""


def residuals_of(exposures: Iterable[Seen]) -> Residuals:
    """Returns the residuals of all these frames."""
    uv, found = [np.zeros((0, 2))], [np.zeros(0)]
    for seen in exposures:
        tracks = seen.tracks
        usable = np.isfinite(tracks.residual_px) & (tracks.status < TrackStatus.LOST)
        uv.append(tracks.uv[usable].astype(float))
        found.append(tracks.residual_px[usable].astype(float))
    return Residuals(np.concatenate(uv), np.concatenate(found))


def histogram(of: Residuals, bins: int = 24) -> tuple[Array, Array]:
    """Edges (bins + 1,) [px] from 0 to the 99th percentile, and counts (bins,); what is larger is in the last."""
    top = float(np.percentile(of.residual_px, 99)) if len(of.residual_px) else 0.0
    edges = np.linspace(0, max(top, 1e-3), bins + 1)
    counts, _ = np.histogram(np.minimum(of.residual_px, edges[-1]), edges)
    return edges, counts.astype(float)


def over_image(of: Residuals, camera: Camera) -> Array:
    """(rows, columns) medians [px]; NaN where a cell has fewer than LEAST."""
    cell = np.floor((of.uv + 0.5) / [camera.width, camera.height] * CELLS).astype(int)
    cell = np.clip(cell, 0, np.array(CELLS) - 1)
    return _medians(cell[:, 1] * CELLS[0] + cell[:, 0], of.residual_px, CELLS[0] * CELLS[1])[:, 0].reshape(CELLS[::-1])


def against_radius(of: Residuals, camera: Camera) -> tuple[Array, Array]:
    """Edges (RINGS + 1,) [px] of rings around the principal point, and in each (RINGS, 2) the median and the 90th
    percentile [px]; NaN where it has fewer than LEAST."""
    corners = np.array([[0, 0], [camera.width, 0], [0, camera.height], [camera.width, camera.height]]) - 0.5
    centre = np.array([camera.cx, camera.cy])
    edges = np.linspace(0, np.linalg.norm(corners - centre, axis=1).max(), RINGS + 1)
    ring = np.clip(np.searchsorted(edges, np.linalg.norm(of.uv - centre, axis=1), side="right") - 1, 0, RINGS - 1)
    return edges, _medians(ring, of.residual_px, RINGS)


def _medians(group: np.ndarray, values: Array, count: int) -> Array:
    """(count, 2) median and 90th percentile of the values of each group."""
    found = np.full((count, 2), np.nan)
    for g in np.unique(group):
        inside = values[group == g]
        if len(inside) >= LEAST:
            found[g] = np.percentile(inside, [50, 90])
    return found
