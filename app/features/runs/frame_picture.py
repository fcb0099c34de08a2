"""The image of a frame of a run, with the tracks that the run had there, as JPEG."""

from __future__ import annotations

import cv2
import numpy as np

from ispom.errors import InputError
from ispom.types import FrameName, Image, Step, Tracks, TrackStatus, main_image

from ...engine.history.record import ExposureRecord, with_parts
from ...engine.run_folder.thumbnail import jpeg
from ...presentation import colours
from ...session.current_run import CurrentRun

QUALITY = 80
WIDTH_PX = 640
"""Width of the image; a smaller one is enlarged, so that tracks do not hide it."""


def frame_picture(run: CurrentRun, index: int, method: str, width: int) -> bytes | None:
    """None where there is no such frame yet, or its image cannot be read. `method` is whose tracks are drawn; one that
    has none there gives the image alone."""
    if not 0 <= index < len(run.history):
        return None
    try:
        camera, image = main_image(run.playback.sequence[index]) or ("video", None)
    except InputError:
        camera, image = _recorded(run, index)
    if image is None or not image.size:
        return None
    drawn = picture(image, _tracks(run, index, method, camera, image) if method else None)
    return jpeg(drawn, QUALITY, width)


def _tracks(run: CurrentRun, index: int, method: str, camera: FrameName, image: Image) -> Tracks | None:
    """Those of the method, or else those that the recording has of the camera."""
    found = tracks_of(run.history[index], method, camera)
    if found is None and run.recorded is not None:
        recorded = run.recorded.tracks(camera, index)
        if recorded is not None:
            return Tracks.of(
                np.arange(len(recorded.uv)), recorded.uv_in(image), status=recorded.classes.astype(np.uint8)
            )
    return found


def _recorded(run: CurrentRun, index: int) -> tuple[FrameName, Image | None]:
    """From the recording of a run whose source is gone."""
    camera: FrameName = "left" if run.history[index].kind == "stereo" else "video"
    return camera, run.recorded.image(camera, index) if run.recorded is not None else None


def tracks_of(record: ExposureRecord, method: str, camera: FrameName) -> Tracks | None:
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
