"""The image of a frame of a run, with the tracks that the run had there, as JPEG."""

from __future__ import annotations

import cv2
import numpy as np

from ispom.errors import InputError
from ispom.types import Frame, Image, Tracks

from ...session.current_run import CurrentRun
from ...views.viser.track_picture import image_of, picture, tracks_of

QUALITY = 80


def frame_picture(run: CurrentRun, index: int, method: str, width: int) -> bytes | None:
    """None where there is no such frame yet, or its image cannot be read. `method` is whose tracks are drawn; one that
    has none there gives the image alone."""
    if not 0 <= index < len(run.history):
        return None
    try:
        name, image = image_of(run.playback.sequence[index])
        camera: Frame = "left" if name == "left" else "video"
    except InputError:
        camera, image = _recorded(run, index)
    if image is None or not image.size:
        return None
    drawn = picture(image, _tracks(run, index, method, camera, image) if method else None)
    height = max(round(drawn.shape[0] * width / drawn.shape[1]), 1)
    if width < drawn.shape[1]:
        drawn = cv2.resize(drawn, (width, height), interpolation=cv2.INTER_AREA)
    encoded = cv2.imencode(".jpg", cv2.cvtColor(drawn, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return encoded[1].tobytes()


def _tracks(run: CurrentRun, index: int, method: str, camera: Frame, image: Image) -> Tracks | None:
    """Those of the method, or else those that the recording has of the camera."""
    found = tracks_of(run.history[index], method, camera)
    if found is None and run.recorded is not None:
        kept = run.recorded.tracks(camera, index)
        if kept is not None:
            return Tracks.of(np.arange(len(kept.uv)), kept.uv_in(image), status=kept.classes.astype(np.uint8))
    return found


def _recorded(run: CurrentRun, index: int) -> tuple[Frame, Image | None]:
    """From the recording of a run whose source is gone."""
    camera: Frame = "left" if run.history[index].kind == "stereo" else "video"
    return camera, run.recorded.image(camera, index) if run.recorded is not None else None
