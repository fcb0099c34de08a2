"""Good, usable or redo, and why: in words, from numbers that stand here."""

from __future__ import annotations

import numpy as np

from ispom.calibration.adjust.solve import Solution
from ispom.calibration.diagnostics.parameters import Parameter
from ispom.calibration.result import CameraResult, Clock, RowError, Verdict
from ispom.geometry import Array

GOOD_RMS, USABLE_RMS = 1 / 1000, 1 / 250
"""Reprojection errors (root mean square) as shares of the image's width."""
GOOD_UNCERTAINTY, USABLE_UNCERTAINTY = 1 / 1000, 1 / 200
"""Of projections, at the 90th percentile over the image, as a share of its width."""
GOOD_HALVES, USABLE_HALVES = 1 / 500, 1 / 100
"""Difference of two halves of the views, the same way: each half is uncertain by sqrt(2) times as much as all views, so
they differ by twice the uncertainty, if it is true. Where they differ by more, images are not of one camera as it is
used: some are turned, mirrored, zoomed or focused otherwise."""
COVERED, BARELY_COVERED = 0.6, 0.25
"""Shares of the image."""
MOSTLY = 0.5
"""Of the images must be used."""
GOOD_ROWS_PX = 0.5
FEW_VIEWS = 8


def verdict(
    solution: Solution,
    cameras: tuple[CameraResult, ...],
    parameters: tuple[Parameter, ...],
    rows: RowError | None,
    used: dict[str, int],
    clock: Clock | None = None,
) -> Verdict:
    """`used` has how many images of each camera are used."""
    redo = _undetermined(parameters)
    minor: list[str] = []
    for c, each in enumerate(cameras):
        name, width = each.views.name, each.camera.width
        own = solution.residuals_px[solution.seen.camera == c]
        rms = float(np.sqrt((own**2).sum(1).mean())) if len(own) else np.inf
        _judge(redo, minor, rms / width, GOOD_RMS, USABLE_RMS, f"{name}: reprojection error {rms:.2f} px")
        if not redo:
            spread = _ninth(each.uncertainty.px)
            said = f"{name}: projections are uncertain by {spread:.2f} px"
            _judge(redo, minor, spread / width, GOOD_UNCERTAINTY, USABLE_UNCERTAINTY, said)
        apart = _ninth(each.halves.px)
        said = f"{name}: two halves of the views differ by {apart:.2f} px"
        if apart > USABLE_HALVES * width:
            said += ": some images are turned, zoomed or focused otherwise, or there are too few"
        _judge(redo, minor, apart / width, GOOD_HALVES, USABLE_HALVES, said)
        covered = each.coverage.covered
        if covered < COVERED:
            minor.append(f"{name}: the board was seen in {100 * covered:.0f} % of the image only")
        count = len(each.views.images)
        if used[name] < MOSTLY * sum(not d.reason for d in each.views.detections):
            redo.append(f"{name}: {used[name]} of {count} images fit together only")
        if used[name] < FEW_VIEWS:
            minor.append(f"{name}: {used[name]} views only")
    if rows is not None and rows.rms_px > GOOD_ROWS_PX:
        minor.append(f"rows of the rectified pair differ by {rows.rms_px:.2f} px")
    if clock is not None and not clock.determined:
        minor.append("video: the clock offset is not determined: move the cameras while they film")
    advice = tuple(dict.fromkeys(f"{each.views.name}: {text}" for each in cameras for text in each.coverage.advice))
    if redo:
        return Verdict("redo", tuple(redo), advice)
    return Verdict("usable" if minor else "good", tuple(minor), advice)


def _undetermined(parameters: tuple[Parameter, ...]) -> list[str]:
    """One reason for each camera that has such parameters."""
    lost: dict[str, list[str]] = {}
    for parameter in parameters:
        if not parameter.determined:
            lost.setdefault(parameter.camera, []).append(parameter.name)
    return [
        f"{name}: the views are too much alike to determine {', '.join(those)}: tilt the board and vary its distance"
        for name, those in lost.items()
    ]


def _judge(redo: list[str], minor: list[str], value: float, good: float, usable: float, said: str) -> None:
    if not value <= usable:
        redo.append(said)
    elif value > good:
        minor.append(said)


def _ninth(px: Array) -> float:
    """The 90th percentile: the outermost corners are beyond any use."""
    return float(np.percentile(px, 90))
