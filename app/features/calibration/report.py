"""The report: one HTML file with all that was seen and found, which needs no network."""

from __future__ import annotations

import numpy as np

from ispom.calibration.result import Calibration, CameraResult

from ...presentation.templating import environment
from .drawings import arrows, bars, grid_of_counts, heat, points
from .words import facts, model_words, parameter_words, used_words

GENERATOR = "ispom calibrate --report"
ARROW = 40.0
"""Factor by which residuals are drawn longer than they are."""
HALVES_ARROW = 20.0
"""Factor by which differences of the two halves are drawn longer than they are."""


def page(found: Calibration) -> str:
    """The whole file."""
    cameras = [camera_values(found, each, c) for c, each in enumerate(found.cameras)]
    names = [f"{parameter.camera} {parameter.name}" for parameter in found.parameters]
    related = [
        (names[i], names[j], float(found.correlations[i, j]))
        for i in range(len(names))
        for j in range(i)
        if abs(found.correlations[i, j]) > 0.7
    ]
    return (
        environment(__name__.rpartition(".")[0])
        .get_template("calibration.html")
        .render(
            generator=GENERATOR,
            found=found,
            facts=facts(found),
            cameras=cameras,
            related=sorted(related, key=lambda each: -abs(each[2])),
            rows=_rows(found),
        )
    )


def camera_values(found: Calibration, each: CameraResult, c: int) -> dict[str, object]:
    """Drawings (SVG) and texts of one camera, by name."""
    solution, size = found.solution, (each.camera.width, each.camera.height)
    mine = solution.seen.camera == c
    uv, residual = solution.seen.uv[mine], solution.residuals_px[mine]
    away = np.linalg.norm(residual, axis=1)
    view = solution.seen.view[mine]
    views = np.unique(view)
    rms = [float(np.sqrt((away[view == v] ** 2).mean())) for v in views]
    images = [each.views.images[found.image_of[v, c]] for v in views]
    counts, edges = np.histogram(away, bins=30)
    return {
        "name": each.views.name,
        "model": model_words(each),
        "used": used_words(found, each),
        "parameters": [parameter_words(p) for p in found.parameters if p.camera == each.views.name],
        "points": points(size, uv, away),
        "residuals": arrows(size, uv, residual, ARROW),
        "uncertainty": heat(size, each.uncertainty.px),
        "halves": arrows(size, each.halves.uv.reshape(-1, 2), _vectors(each), HALVES_ARROW),
        "coverage": grid_of_counts(size, each.coverage.counts),
        "histogram": bars([f"{edge:.2f} px" for edge in edges[1:]], counts.astype(float).tolist()),
        "views": bars([f"{name}: {value:.3f} px" for name, value in zip(images, rms, strict=True)], rms),
        "tilts": points(
            (120, 120), 60 + each.coverage.tilts_deg[:, ::-1] * (1, -1), np.zeros(len(each.coverage.tilts_deg)), 2.0
        ),
        "rejected": [r for r in found.rejected if r.camera == each.views.name and r.point is None],
    }


def _vectors(each: CameraResult) -> np.ndarray:
    """(N, 2) [px]."""
    vectors = each.halves.vectors
    return np.zeros((each.halves.px.size, 2)) if vectors is None else vectors.reshape(-1, 2)


def _rows(found: Calibration) -> object:
    """The pair's rows over the left image."""
    if found.row_error is None:
        return None
    left = found.cameras[0].camera
    vectors = np.column_stack([np.zeros(len(found.row_error.rows_px)), found.row_error.rows_px])
    return arrows((left.width, left.height), found.row_error.uv_left, vectors, ARROW)
