"""Images and tracks in the recording of a run. Tracks have positions and states there, but no ids."""

from __future__ import annotations

import re
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from rerun.chunk import LazyStore, RrdReader

from ispom.types import FrameName, Image, TrackStatus

from ...engine.inspection.colouring import SCALES, Colouring
from ...views.rerun.coloured import path_of
from ...views.rerun.entities import shown_scale

MOST_REMEMBERED = 8
"""Number of frames whose tracks stay in memory, so that another colouring or panel does not read them again."""
_COUNT = re.compile(r"(\d+) ")


@dataclass(frozen=True, eq=False)
class RecordedTracks:
    """The tracks of one camera at one frame, as Rerun shows them."""

    uv: NDArray[np.float32]
    """(N, 2) in Rerun's coordinates on the shown image; large sets are thinned."""
    classes: NDArray[np.uint16]
    """(N,) TrackStatus, or the bin of a colouring."""
    counts: dict[TrackStatus, int]
    """Number of tracks by status, including those that are not drawn."""

    def uv_in(self, image: Image) -> NDArray[np.float32]:
        """(N, 2) [px] in the camera's image, whether that was read from the source or from the recording."""
        return self.uv / np.float32(shown_scale(image.shape[1], image.shape[0])) - np.float32(0.5)


class RecordedViews:
    """Reads a finished recording, in any thread. Unreadable data are treated as absent."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._store: LazyStore | None = None
        self._lock = Lock()
        self._known: OrderedDict[tuple[str, int, str], RecordedTracks | None] = OrderedDict()

    def tracks(self, camera: FrameName, index: int, by: Colouring = "state") -> RecordedTracks | None:
        """None where the frame has no tracks of this camera in the recording."""
        key = (camera, index, by)
        with self._lock:
            if key not in self._known:
                self._known[key] = self._read_tracks(camera, index, by)
            self._known.move_to_end(key)
            while len(self._known) > MOST_REMEMBERED:
                self._known.popitem(last=False)
            return self._known[key]

    def image(self, camera: FrameName, index: int) -> Image | None:
        """The image as it was recorded, at `shown_scale`; None where there is none."""
        with self._lock:
            row = self._row(f"/{camera}/image", index, "EncodedImage:blob")
        if row is None or not row["EncodedImage:blob"]:
            return None
        blob = row["EncodedImage:blob"][0]
        found = cv2.imdecode(np.asarray(blob, np.uint8), cv2.IMREAD_UNCHANGED)
        if found is None:
            return None
        return np.asarray(found if found.ndim == 2 else cv2.cvtColor(found, cv2.COLOR_BGR2RGB), np.uint8)

    def _read_tracks(self, camera: FrameName, index: int, by: Colouring) -> RecordedTracks | None:
        entity = f"/{path_of(camera, by)}" if by in SCALES else f"/{camera}/tracks"
        row = self._row(entity, index, "Points2D:positions", "Points2D:class_ids")
        if row is None or row["Points2D:positions"] is None or row["Points2D:class_ids"] is None:
            return None
        uv = np.asarray(row["Points2D:positions"], np.float32).reshape(-1, 2)
        classes = np.asarray(row["Points2D:class_ids"], np.uint16)
        if len(uv) != len(classes):
            return None
        legend = self._row(f"/{camera}/legend", index, "Points2D:labels", "Points2D:class_ids")
        return RecordedTracks(uv, classes, {} if legend is None else _counts(legend))

    def _row(self, entity: str, index: int, *columns: str) -> dict[str, Any] | None:
        """The values of an entity's columns that were logged at this frame."""
        try:
            if self._store is None:
                self._store = RrdReader(self.path).store()
            for batch in self._batches(self._store, entity, columns):
                found = np.flatnonzero(batch.column("exposure").to_numpy(zero_copy_only=False) == index)
                if len(found):
                    at = int(found[-1])
                    return {name: batch.column(name)[at].as_py() for name in columns}
        except (OSError, RuntimeError, ValueError):
            return None
        return None

    @staticmethod
    def _batches(store: LazyStore, entity: str, columns: tuple[str, ...]) -> Iterator[pa.RecordBatch]:
        for chunk in store.stream().filter(content=entity, is_static=False):
            batch = chunk.to_record_batch()
            if {"exposure", *columns} <= set(batch.schema.names):
                yield batch


def _counts(legend: dict[str, Any]) -> dict[TrackStatus, int]:
    """By status, as in the legend of the recorded image."""
    labels, classes = legend["Points2D:labels"] or (), legend["Points2D:class_ids"] or ()
    found = {}
    for label, number in zip(labels, classes, strict=False):
        count = _COUNT.match(label)
        if count is not None and number < len(TrackStatus):
            found[TrackStatus(number)] = int(count[1])
    return found
