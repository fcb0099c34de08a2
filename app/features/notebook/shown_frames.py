"""What a view in a cell shows of each frame of a run: image, tracks, verdict and checks."""

from __future__ import annotations

from base64 import b64encode
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.methods import method as registered
from ispom.notebook.folders import StoredRun
from ispom.notebook.run import Run
from ispom.types import Measurement, Rig, Step, images_of, main_image

from ...engine.history.quantities import step_values
from ...engine.history.quantity import Value
from ...engine.history.record import with_parts
from ...engine.run_folder.run_folder import RECORDING
from ...engine.run_folder.step_reader import StoredStep as Row
from ...engine.run_folder.step_reader import stored_steps
from ...engine.verdict import verdict
from ...presentation.decisions import mark, sentence
from ...session.review.recorded_tracks import RecordedViews
from ...session.review.records import step_of
from ...views.rerun import entities
from ...views.rerun.parts import image_root
from ..explain.card import TINTS

QUALITY = 60
"""Quality of the JPEG images: a frame with 300 tracks takes about 40 kB."""
Message = dict[str, Any]
"""What `view.js` is told of a frame, as JSON has it."""


@dataclass(frozen=True, eq=False)
class Picture:
    """The image of a frame as it is shown, and the tracks in it."""

    camera: str = ""
    """Empty where the frame has no image."""
    jpeg: bytes = b""
    size: tuple[int, int] = (0, 0)
    """Width and height [px]."""
    xy: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(N, 2) [px] of the shown image, from the corner of its first pixel."""
    status: NDArray[np.integer] = field(default_factory=lambda: np.zeros(0, np.uint8))
    """(N,) TrackStatus."""
    ids: NDArray[np.int64] | None = None
    """(N,); None where nobody knows them."""


class ShownFrames(Protocol):
    """The frames of a run of one method."""

    @property
    def numbers(self) -> tuple[int, ...]:
        """Of the sequence, in the order of the steps."""
        ...

    def message(self, place: int) -> Message:
        """Of the frame at a place among `numbers`."""
        ...


@dataclass(frozen=True, eq=False)
class ComputedFrames:
    """Those of a run that was computed here."""

    run: Run
    numbers: tuple[int, ...]

    def message(self, place: int) -> Message:
        """Reads its image again; a frame that cannot be read any more has none."""
        number = self.numbers[place]
        try:
            measurement = self.run.sequence[number]
        except InputError:
            measurement = None
        return frame_message(number, measurement, self.run.steps[place], self.run.rig)


def frame_message(number: int, measurement: Measurement | None, step: Step, rig: Rig) -> Message:
    """Of a step that was computed here."""
    picture = Picture() if measurement is None else _picture(measurement, step, rig)
    return message_of(number, step, step_values(step, None), picture)


def computed_frames(run: Run) -> ComputedFrames:
    """The frames of the steps, in their order."""
    sequence, kinds = run.sequence, registered(run.method).sensors
    at_time = defaultdict[int, list[int]](list)
    for i, (time_ns, kind) in enumerate(zip(sequence.times_ns.tolist(), sequence.kinds, strict=True)):
        if kind in kinds:
            at_time[time_ns].append(i)
    return ComputedFrames(run, tuple(at_time[step.time_ns].pop(0) for step in run.steps))


@dataclass(frozen=True, eq=False)
class StoredFrames:
    """Those of a run folder, whose recording has the images."""

    numbers: tuple[int, ...]
    rows: tuple[Row, ...]
    views: RecordedViews
    cameras: tuple[str, ...]
    """Where the recording may have an image."""

    def message(self, place: int) -> Message:
        """Reads its image from the recording; without one it has none."""
        row = self.rows[place]
        return message_of(row.exposure, step_of(row), row.values, self._picture(row.exposure))

    def _picture(self, number: int) -> Picture:
        images = ((camera, self.views.image(camera, number)) for camera in self.cameras)
        camera, image = next(((camera, image) for camera, image in images if image is not None), ("", None))
        if image is None:
            return Picture()
        found = Picture(camera.rpartition("/")[2], entities.jpeg_bytes(image, QUALITY), image.shape[1::-1])
        tracks = self.views.tracks(camera, number)
        return found if tracks is None else replace(found, xy=tracks.uv, status=tracks.classes)


def stored_frames(run: StoredRun) -> StoredFrames:
    """Reads the rows of the folder. InputError where they are not as written."""
    with stored_steps(run.folder) as steps:
        rows = tuple(row for row in steps if row.method == run.method)
    cameras = tuple(image_root(name) for name in dict.fromkeys(("video", "left", *run.rig.cameras)))
    return StoredFrames(tuple(row.exposure for row in rows), rows, RecordedViews(run.folder / RECORDING), cameras)


def message_of(number: int, step: Step, values: Mapping[str, Value], picture: Picture) -> Message:
    """All that is shown of a step; `values` as of `verdict`."""
    found, checks = verdict(step, number, values), registered(step.method).checks
    known = np.isfinite(picture.xy).all(1)
    signs = [(mark(decision), decision) for decision in step.decisions]
    return {
        "frame": number,
        "time_s": round(step.time_ns * 1e-9, 3),
        "camera": picture.camera,
        "image": f"data:image/jpeg;base64,{b64encode(picture.jpeg).decode()}" if picture.jpeg else "",
        "size": list(picture.size),
        "xy": picture.xy[known].round(1).astype(float).round(1).ravel().tolist(),
        "status": picture.status[known].tolist(),
        "ids": None if picture.ids is None else picture.ids[known].tolist(),
        "severity": str(found.severity),
        "headline": found.headline,
        "detail": found.detail,
        "checks": [[sign, TINTS.get(sign, "quiet"), sentence(d, checks.get(d.key))] for sign, d in signs],
    }


def _picture(measurement: Measurement, step: Step, rig: Rig) -> Picture:
    """Of the camera in which the step, or one inside it, has tracks; else of the main camera."""
    images = images_of(measurement)
    own = next((s for s in with_parts((step,)) if any(name in images for name in s.tracks)), step)
    main, _ = main_image(measurement) or (next(iter(images), ""), None)
    name = next((name for name in own.tracks if name in images), main)
    if name not in images or not images[name].size:
        return Picture()
    camera, (height, width) = rig.camera(name), images[name].shape[:2]
    scale = entities.shown_scale(width, height)
    found = Picture(name, entities.jpeg_bytes(images[name], QUALITY), (round(width * scale), round(height * scale)))
    if name not in own.tracks:
        return found
    tracks = entities.thinned(own.tracks[name], camera)
    return replace(found, xy=entities.shown_uv(tracks.uv, camera), status=tracks.status, ids=tracks.ids)
