"""The image of a frame with the tracks of a method drawn on it."""

from __future__ import annotations

import cv2
import numpy as np

from ispom.types import Exposure, Image, Step, StereoPair, Tracks, TrackStatus

from ...engine.history.record import ExposureRecord, with_parts
from ...presentation import colours

WIDTH_PX = 640
"""Of the picture; a smaller image is drawn larger, so that tracks do not hide it."""


def image_of(exposure: Exposure) -> tuple[str, Image]:
    """The camera whose tracks are drawn, and its image."""
    return ("left", exposure.left) if isinstance(exposure, StereoPair) else ("video", exposure.image)


def tracks_of(record: ExposureRecord, method: str, camera: str) -> Tracks | None:
    """Those that a method used at a frame, its own or those of a method that it builds on."""
    steps = tuple[Step, ...](step for step in record.steps if step.method == method)
    return next((s.tracks[camera] for s in with_parts(steps) if camera in s.tracks), None)


def picture(image: Image, tracks: Tracks | None) -> Image:
    """(H, WIDTH_PX, 3) RGB, each track in the colour of its status; dropped ones are crosses."""
    scale = WIDTH_PX / image.shape[1]
    size = (WIDTH_PX, max(round(image.shape[0] * scale), 1))
    drawn = cv2.resize(image, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    drawn = cv2.cvtColor(drawn, cv2.COLOR_GRAY2RGB) if drawn.ndim == 2 else np.ascontiguousarray(drawn)
    if tracks is None or not len(tracks):
        return drawn  # type: ignore[return-value]
    seen = np.isfinite(tracks.uv).all(1)
    # Whole images are scaled, so that pixels' corners and not their centres correspond.
    places = np.rint((tracks.uv[seen] + 0.5) * scale - 0.5).astype(int)
    for (u, v), status in zip(places.tolist(), tracks.status[seen].tolist(), strict=True):
        colour = colours.TRACK[TrackStatus(status)]
        if status < TrackStatus.LOST:
            cv2.circle(drawn, (u, v), 3, colour, -1, cv2.LINE_AA)
        else:
            cv2.drawMarker(drawn, (u, v), colour, cv2.MARKER_TILTED_CROSS, 8, 1, cv2.LINE_AA)
    return drawn  # type: ignore[return-value]
