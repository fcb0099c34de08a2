"""The worst moments of a run, and what the camera saw then."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ispom.errors import InputError
from ispom.types import Image, TrackStatus, main_image

from ...engine.run_folder.run_file import read_run_file
from ...presentation import colours
from ...presentation.texts import computing_time, length
from ...session.review.stored import stored_source
from .folder import Run
from .steps import Steps

MOST, ALL = 6, 30
"""Moments of a run, and of a whole page."""
WIDTH_PX = 400
QUALITY = 70
RECORDING = "run.rrd"


@dataclass(frozen=True)
class Moment:
    """One frame, and everything that was bad about it."""

    exposure: int
    time_ns: int
    why: tuple[str, ...]
    jpeg: bytes | None = None

    @property
    def source(self) -> str:
        """The image as a page takes it; empty without one."""
        return "" if self.jpeg is None else "data:image/jpeg;base64," + base64.b64encode(self.jpeg).decode()


def worst(run: Run, most: int = MOST) -> list[Moment]:
    """Returns at most `most` moments in the order of time. Those where a method was lost are chosen first, then the
    worst of each measure."""
    found: dict[int, Moment] = {}
    for steps, row, why in _candidates(run):
        exposure = int(steps.exposures[row])
        if exposure in found:
            found[exposure] = replace(found[exposure], why=(*found[exposure].why, why))
        elif len(found) < most:
            found[exposure] = Moment(exposure, int(steps.times_ns[row]), (why,))
    return sorted(found.values(), key=lambda moment: moment.exposure)


def _candidates(run: Run) -> Iterator[tuple[Steps, int, str]]:
    for method, steps in run.steps.items():
        lost = np.array([status == "lost" for status in steps.status])
        starts = np.flatnonzero(lost & ~np.append(False, lost[:-1]))
        for row in starts[:2]:
            yield steps, int(row), f"{method}: lost"
    measures = (
        ("error_m", 1, "largest live error", "m"),
        ("residual_median_px", 1, "largest median residual", "px"),
        ("inliers", -1, "fewest inliers", ""),
    )
    for name, sign, what, unit in measures:
        for method, steps in run.steps.items():
            values = sign * steps.columns[name]
            if np.isfinite(values).any():
                row = int(np.nanargmax(values))
                value = float(steps.columns[name][row])
                yield steps, row, f"{method}: {what}, {length(value) if unit == 'm' else _with_unit(value, unit)}"
    for method, steps in run.steps.items():
        alive = steps.columns["alive"]
        share = steps.dropped / np.maximum(steps.dropped + alive, 1)
        if np.isfinite(share).any():
            row = int(np.nanargmax(share))
            yield steps, row, f"{method}: most tracks ended, {_with_unit(100 * share[row], '%')}"
    for method, steps in run.steps.items():
        row = int(np.nanargmax(steps.columns["seconds"])) if np.isfinite(steps.columns["seconds"]).any() else 0
        yield steps, row, f"{method}: slowest, {computing_time(float(steps.columns['seconds'][row]))}"


def _with_unit(value: float, unit: str) -> str:
    return f"{value:.3g} {unit}".strip() if abs(value) < 1000 else f"{value:.0f} {unit}".strip()


def with_images(run: Run, moments: list[Moment]) -> tuple[list[Moment], str]:
    """The moments with small JPEGs, and where those are from, or why there are none."""
    indices = {moment.exposure for moment in moments}
    if not indices:
        return moments, ""
    try:
        found, origin = _recorded(run.path / RECORDING, indices), f"from {RECORDING}"
    except (OSError, RuntimeError, ValueError, cv2.error) as error:
        found, origin = {}, f"{RECORDING} cannot be read ({type(error).__name__})"
    if not found:
        try:
            found, origin = _reread(run, indices), f"read again from {run.manifest['source']}"
        except (InputError, OSError, ValueError, TypeError) as error:
            return moments, f"No images: {origin}, and the source cannot be opened ({error})."
    return [replace(m, jpeg=found.get(m.exposure)) for m in moments], f"Images {origin}."


def _recorded(path: Path, indices: set[int]) -> dict[int, bytes]:
    """Images and tracks of a recording, by frame."""
    if not path.exists():
        return {}
    from rerun.chunk import RrdReader  # takes a second

    images: dict[int, Image] = {}
    marks: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    for camera in ("video", "left"):
        for row in _rows(RrdReader(path), f"/{camera}/image", indices, ("EncodedImage:blob",)):
            image = cv2.imdecode(np.array(row[1][0], np.uint8), cv2.IMREAD_COLOR)
            if image is not None:
                images[row[0]] = np.asarray(image, np.uint8)
        columns = ("Points2D:positions", "Points2D:class_ids")
        for exposure, (uv, status) in _rows(RrdReader(path), f"/{camera}/tracks", indices, columns):
            if uv and status and len(uv) == len(status):
                marks[exposure] = np.array(uv, float) - 0.5, np.array(status, int)
    return {exposure: _small(image, marks.get(exposure)) for exposure, image in images.items()}


def _rows(reader: Any, entity: str, indices: set[int], columns: tuple[str, ...]) -> Iterator[tuple[int, tuple]]:
    for chunk in reader.stream().filter(content=entity):
        batch = chunk.to_record_batch()
        if "exposure" not in batch.schema.names or not set(columns) <= set(batch.schema.names):
            continue
        for i, exposure in enumerate(batch.column("exposure").to_pylist()):
            if exposure in indices:
                yield exposure, tuple(batch.column(name)[i].as_py() for name in columns)


def _reread(run: Run, indices: set[int]) -> dict[int, bytes]:
    sequence = stored_source(run.path, read_run_file(run.path), cure="no image of it is shown").opened()
    found = {}
    for index in sorted(indices):
        if 0 <= index < len(sequence):
            shown = main_image(sequence[index])
            if shown is None:
                continue
            image = shown[1]
            bgr = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR if image.ndim == 2 else cv2.COLOR_RGB2BGR)
            found[index] = _small(np.asarray(bgr, np.uint8), None)
    return found


def _small(bgr: Image, tracks: tuple[np.ndarray, np.ndarray] | None) -> bytes:
    """A JPEG of at most WIDTH_PX columns, with the tracks in their colours."""
    factor = min(1.0, WIDTH_PX / bgr.shape[1])
    small = cv2.resize(bgr, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    for (u, v), status in zip(*tracks, strict=True) if tracks else ():
        if status in set(TrackStatus) and np.isfinite((u, v)).all():
            colour = colours.TRACK[TrackStatus(status)]
            cv2.circle(small, (round(u * factor), round(v * factor)), 2, colour[::-1], 1, cv2.LINE_AA)
    return cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
