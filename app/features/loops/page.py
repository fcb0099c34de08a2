"""The page: one HTML file, without network and script, that is written candidate by candidate."""

from __future__ import annotations

import base64
from collections.abc import Sequence as Listed
from pathlib import Path
from typing import Any

import numpy as np

from ispom.errors import UnreadableImage
from ispom.estimators.modern.trials import Matches, Trial
from ispom.geometry import Array
from ispom.io.whole import write_parts
from ispom.types import Camera, Image, Sequence, images_of

from ...engine.run_folder.thumbnail import jpeg
from ...presentation.templating import environment
from ..report.html import PACKAGE as REPORT
from ..report.html import POLICY, own_text, shown
from .candidate import Candidate, WhatIf
from .docket import Docket
from .text import answer_lines, refusals, summary, truth_text

PACKAGE = __name__.rpartition(".")[0]
GENERATOR = "ISPOM loops"
WIDTH_PX, QUALITY = 640, 80
"""Width and JPEG quality of an image in the page."""
MOST_LINES = 150
"""Matches that are drawn of each kind, evenly chosen: more hide the images."""
GAP_PX = 8
"""Gap between both images."""


def write_page(
    path: Path,
    title: str,
    sequence: Sequence,
    candidates: Listed[tuple[Candidate, Trial]],
    what_if: Listed[WhatIf],
    docket: Docket,
) -> None:
    """Writes the page; the images of one candidate at a time are in memory."""
    made = environment(PACKAGE, REPORT)
    made.filters |= {"shown": shown, "truth": truth_text, "answer": answer_lines}
    template = made.get_template("loops.html")
    parts = template.generate(
        policy=POLICY,
        generator=GENERATOR,
        css=own_text("page.css"),
        title=title,
        subtitle=summary(docket),
        refusals=refusals(docket),
        what_if=what_if,
        left=docket.counts.total() - len(candidates),
        cards=(_card(sequence, each, one) for each, one in candidates),
    )
    write_parts(path, parts)


def _card(sequence: Sequence, each: Candidate, one: Trial) -> dict[str, Any]:
    first, then = (_image(sequence, frame, each.camera) for frame in (each.first_frame, each.then_frame))
    camera = sequence.rig.camera(each.camera)
    scale = WIDTH_PX / camera.width
    height = round(camera.height * scale)
    matches = [] if one.matches is None else lines_of(one.matches, camera, scale)
    return {
        "of": each,
        "images": [None if image is None else _data(image) for image in (first, then)],
        "width": WIDTH_PX,
        "height": height,
        "gap": GAP_PX,
        "outliers": [line for line, inlier in matches if not inlier],
        "inliers": [line for line, inlier in matches if inlier],
    }


def lines_of(matches: Matches, camera: Camera, scale: float) -> list[tuple[tuple[float, ...], bool]]:
    """Returns the matches that are drawn, as (x1, y1, x2, y2) over both images side by side, and which are inliers.

    `scale` is of the shown images relative to the camera's. A match is left out where a point of a neighbour of the
    earlier keyframe is outside of its image."""
    found = list[tuple[tuple[float, ...], bool]]()
    for inlier in (False, True):
        some = np.flatnonzero(matches.inlier == inlier)
        some = some[np.linspace(0, len(some) - 1, min(len(some), MOST_LINES)).astype(int)] if len(some) else some
        first, then = (scale * _pixels(camera, x[some]) for x in (matches.first, matches.then))
        for (x1, y1), (x2, y2) in zip(first.tolist(), then.tolist(), strict=True):
            if 0 <= x1 <= scale * camera.width and 0 <= y1 <= scale * camera.height and np.isfinite(x2 + y2):
                line = tuple(round(v, 1) for v in (x1, y1, x2 + WIDTH_PX + GAP_PX, y2))
                found.append((line, inlier))
    return found


def _pixels(camera: Camera, x: Array) -> Array:
    """Returns pixels (N, 2) of normalised coordinates (N, 2)."""
    return camera.project(np.column_stack([x, np.ones(len(x))]))


def _image(sequence: Sequence, frame: int, camera: str) -> Image | None:
    try:
        return images_of(sequence[frame]).get(camera)
    except UnreadableImage:
        return None


def _data(image: Image) -> str:
    return base64.b64encode(jpeg(image, QUALITY, WIDTH_PX)).decode()
