"""Tracks on images, coloured by age, residual or depth. Each has its entity; the layout shows at most one of them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import rerun as rr

from ispom.types import Camera, Rig, Tracks, TrackStatus

from ...engine.inspection.colouring import SCALES, Colouring, palette
from ...engine.inspection.knowledge import Knowledge
from ...engine.inspection.sightings import Seen
from . import entities
from .batch import Entry

LEGEND_ROW = 0.1
"""Distance of a legend's rows, in heights of the image."""


def path_of(camera: str, by: Colouring) -> str:
    return f"{camera}/coloured/{by}"


class ColouredTracks:
    """Draws the coloured tracks of one run. It keeps ages and depths of the live tracks, by camera."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._known: dict[str, Knowledge] = {}

    def opening(self) -> Iterator[Entry]:
        """What the colours mean; static."""
        for name, camera in (("video", self._rig.video), ("left", self._rig.left)):
            if camera is None:
                continue
            for by in SCALES:
                yield Entry(path_of(name, by), _classes(by), static=True)
                yield from _legend(f"{path_of(name, by)}/legend", by, camera)

    def learn(self, seen: Seen) -> None:
        """Takes each frame of a camera once, whether it is drawn or not."""
        self._known[seen.camera] = self._known.get(seen.camera, Knowledge()).after(seen, self._rig)

    def entries(self, seen: Seen, shown: Tracks) -> Iterator[Entry]:
        """Yields the live ones of the frame's drawn tracks, once for each colouring."""
        camera, living = self._rig.camera(seen.camera), shown.status < TrackStatus.LOST
        uv = entities.shown_uv(shown.uv[living], camera)
        for by in SCALES:
            bins = self._known[seen.camera].bins(shown, by)[living].astype(np.uint16)
            yield Entry(path_of(seen.camera, by), rr.Points2D(uv, class_ids=bins, radii=[-2.0], show_labels=False))


def _classes(by: Colouring) -> rr.AnnotationContext:
    """Returns the meaning of the class ids, which the viewer shows on hovering."""
    labels = zip(SCALES[by].labels(), palette(), strict=True)
    return rr.AnnotationContext([(i, f"{by}: {text}", colour) for i, (text, colour) in enumerate(labels)])


def _legend(path: str, by: Colouring, camera: Camera) -> Iterator[Entry]:
    """Yields the legend next to or below the image, like that of the states."""
    labels = SCALES[by].labels()
    places = entities.legend_places(len(labels), camera, LEGEND_ROW)
    yield from entities.legend_entries(path, list(range(len(labels))), labels, places, static=True)
