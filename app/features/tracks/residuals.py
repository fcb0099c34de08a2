"""Residuals: how many of which size, over the image, and against the distance from the principal point."""

from __future__ import annotations

from typing import Any

import numpy as np

from ispom.types import Camera

from ...engine.inspection.colouring import SCALES, palette
from ...engine.inspection.looked import EXPOSURES, Looked
from ...engine.inspection.residuals import Residuals, against_radius, histogram, over_image, residuals_of
from ...presentation import colours
from ...views.viser.panels import renderer

render = renderer(__package__)

WIDTH, HEIGHT = 330.0, 80.0


def residuals_report(looked: Looked) -> str:
    """Residuals of the last EXPOSURES frames of the picture's camera, as HTML."""
    views = looked.recent[-EXPOSURES:]
    found = residuals_of(views)
    if not len(found.residual_px):
        return render("residuals.html", note="No residuals: no pose of these frames was fitted to tracks.")
    camera = looked.of_camera(looked.pictured)
    label = colours.label(views[-1].step.method)
    title = f"{len(found.residual_px)} residuals of {len(views)} frames up to {views[-1].index}: {label}"
    known = {"title": title, "bars": _bars(found), "image": _image(found, camera), "radius": _radius(found, camera)}
    return render("residuals.html", note="", width=WIDTH, height=HEIGHT, **known)


def _bars(found: Residuals) -> dict[str, Any]:
    edges, counts = histogram(found)
    wide, top = WIDTH / len(counts), counts.max()
    bars = [
        {
            "x": round(i * wide, 1),
            "width": round(wide - 1, 1),
            "height": round(HEIGHT * n / top, 1),
            "hint": f"{a:.2f} to {b:.2f} px: {n:.0f}",
        }
        for i, (n, a, b) in enumerate(zip(counts, edges[:-1], edges[1:], strict=True))
    ]
    median, p95 = np.percentile(found.residual_px, [50, 95])
    return {"bars": bars, "top": f"{edges[-1]:.2f} px", "text": f"median {median:.2f} px, 95 % below {p95:.2f} px"}


def _image(found: Residuals, camera: Camera) -> dict[str, Any]:
    medians = over_image(found, camera)
    rows, columns = medians.shape
    wide, high = WIDTH / columns, WIDTH * camera.height / camera.width / rows
    tints = palette()
    cells = [
        {
            "x": round(column * wide, 1),
            "y": round(row * high, 1),
            "colour": colours.css(tints[int(SCALES["residual"].bins(medians[row : row + 1, column])[0])]),
            "hint": "too few" if np.isnan(medians[row, column]) else f"median {medians[row, column]:.2f} px",
        }
        for row in range(rows)
        for column in range(columns)
    ]
    legend = [(colours.css(tint), text) for tint, text in zip(tints, SCALES["residual"].labels(), strict=True)]
    size = {"wide": round(wide - 1, 1), "high": round(high - 1, 1), "height": round(rows * high, 1)}
    return {"cells": cells, "legend": legend} | size


def _radius(found: Residuals, camera: Camera) -> dict[str, Any]:
    edges, rings = against_radius(found, camera)
    middle = (edges[:-1] + edges[1:]) / 2
    top = float(np.nanmax(rings)) if np.isfinite(rings).any() else 1.0
    lines = []
    for column in rings.T:
        known = np.isfinite(column)
        at = np.column_stack([middle[known] / edges[-1] * WIDTH, HEIGHT * (1 - column[known] / max(top, 1e-6))])
        lines.append(" ".join(f"{x:.1f},{y:.1f}" for x, y in at.tolist()))
    return {"median": lines[0], "p90": lines[1], "top": f"{top:.2f} px", "end": f"{edges[-1]:.0f} px"}
