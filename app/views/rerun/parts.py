"""The parts of the views of one frame, and their bytes for a viewer that has the parts of one frame only.

Rerun shows at each time the latest value before it, and its viewer discards old values when its memory is full. So it
could show the tracks of a frame over the image of an older one. Therefore the viewer never gets the images, tracks and
maps of a run along its timeline. It gets the parts of the frame that is shown as static data, of which it keeps one
value each; the parts of another frame replace them.

    video/*, left/*, right/*,   the parts of exactly this frame, and of the other camera's latest one
    camera/NAME/*
    world/view/METHOD/CAMERA
    world/*, decisions          the latest value of each up to this frame
    all of an `Overlay`         whatever the frame
"""

from __future__ import annotations

import re
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from threading import Lock
from typing import Protocol

import cv2
import numpy as np
import pyarrow as pa
import rerun as rr
from rerun.chunk import Chunk

from ispom.types import Kind

from .batch import Entry
from .rrd import messages
from .streams import APPLICATION

Part = tuple[str, str]
"""Path of an entity, and the archetype of some of its components."""
OTHER = "camera"
"""Root of the entities of all cameras with other names. Their frames have one kind and are drawn together."""
CAMERAS: dict[Kind, tuple[str, ...]] = {"video": ("video",), "stereo": ("left", "right"), "cameras": (OTHER,)}
"""The cameras whose images are drawn, by the kind of a frame; other measurements are not drawn."""
IMAGE, CLEAR = "EncodedImage", "Clear"
STAGE = "stage"
"""Entity and timeline that show which message the viewer processed last."""
FLUSH_S = 5.0
"""Longest wait for Rerun's own threads."""


def image_root(camera: str) -> str:
    """Returns the root of all entities in the image of a camera."""
    return camera if camera in ("video", "left", "right") else f"{OTHER}/{camera}"


def is_part(path: str) -> bool:
    """Returns whether data logged over time at this path are a part of the views of a frame; the page draws no
    others."""
    path = path.removeprefix("/")
    below = path.startswith(("video/", "left/", "right/", f"{OTHER}/", "world/")) and not re.fullmatch(
        "world/[^/]+/final", path
    )
    return below or path == "decisions"


def camera_of(path: str) -> str | None:
    """Returns the camera of an entity that belongs to the frame of one camera: one in its image, or that image in the
    3-D view. None for other entities."""
    first, *others = path.removeprefix("/").split("/")
    if first == "world":
        return others[2] if len(others) == 3 and others[0] == "view" else None
    return first if any(first in cameras for cameras in CAMERAS.values()) else None


def latest_of_each_camera(kinds: Sequence[Kind], index: int) -> dict[str, int]:
    """By camera, the last frame up to this one."""
    found: dict[str, int] = {}
    for kind in set(kinds):
        at = next((i for i in range(min(index, len(kinds) - 1), -1, -1) if kinds[i] == kind), None)
        if at is not None:
            found |= dict.fromkeys(CAMERAS.get(kind, ()), at)
    return found


@dataclass(frozen=True)
class Scene:
    """The parts that are shown at a frame."""

    index: int
    versions: Mapping[Part, Hashable]
    """By part, the version of its value; a part that is missing here is empty."""
    missing: bool = False
    """Whether an image of it is still to come."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """One value of an overlay."""

    columns: pa.RecordBatch
    index: int | None
    """The frame that it belongs to; None for all."""


class Overlay:
    """Entities that are drawn over a run's frames and depend on the session: the selected track, other branches, and so
    on."""

    def __init__(self) -> None:
        self._groups: dict[str, dict[Part, Drawn]] = {}
        self.parts: Mapping[Part, Drawn] = {}
        """The parts of all groups. Each change makes another object, so readers should read it once."""

    def draw(self, group: str, entries: Iterable[Entry], index: int | None = None) -> bool:
        """Replaces all entries of a group, and returns whether that changed anything."""
        before, now = self._groups.get(group, {}), dict[Part, Drawn]()
        for entry in entries:
            columns = columns_of(entry.path, entry.value)
            archetype = archetype_of(columns)
            part, columns = (entry.path, archetype), components_of(columns, archetype)
            old = before.get(part)
            same = old is not None and old.index == index and old.columns.equals(columns)
            now[part] = old if old is not None and same else Drawn(columns, index)
        self._groups[group] = now
        self.parts = {part: drawn for parts in self._groups.values() for part, drawn in parts.items()}
        return now != before

    def at(self, index: int) -> dict[Part, Drawn]:
        """Returns the parts that are shown at a frame."""
        return {part: drawn for part, drawn in self.parts.items() if drawn.index is None or drawn.index == index}


class SceneSource(Protocol):
    """The frames of one run, from which a viewer is fed."""

    run: str
    recording_id: str
    overlay: Overlay

    @property
    def end(self) -> int:
        """Frames that can be shown so far."""
        ...

    @property
    def expected(self) -> int:
        """Returns the number of frames that are available soon."""
        ...

    def opening(self) -> bytes:
        """Returns messages with the layout and the data of the whole run; empty until they are known."""
        ...

    def scene(self, index: int) -> Scene: ...

    def request(self, index: int) -> None:
        """Asks for the images that a frame misses."""
        ...

    def value(self, part: Part, version: Hashable) -> pa.RecordBatch | None:
        """The part's columns, of one row; None where they are lost."""
        ...

    def any_of_each_part(self) -> Mapping[Part, Hashable]:
        """All parts of the run, with a version of each."""
        ...


def components_of(batch: pa.RecordBatch, archetype: str, row: int = 0) -> pa.RecordBatch:
    """Returns one row of a chunk with the columns of an archetype, without times and ids."""
    fields = [
        (i, field)
        for i, field in enumerate(batch.schema)
        if (field.metadata or {}).get(b"rerun:kind") == b"data" and field.name.partition(":")[0] == archetype
    ]
    path = {b"rerun:entity_path": batch.schema.metadata[b"rerun:entity_path"]}
    columns = [batch.column(i).slice(row, 1) for i, _ in fields]
    return pa.record_batch(columns, pa.schema([field for _, field in fields], metadata=path))


class SceneWriter:
    """Writes messages for one viewer. It remembers which parts the viewer has, and writes only those that differ."""

    def __init__(self, source: SceneSource, *, fresh: bool = True) -> None:
        """`fresh`: the viewer has no parts yet; otherwise its parts are unknown."""
        self.source = source
        self._lock = Lock()
        self._stream = rr.RecordingStream(APPLICATION, recording_id=source.recording_id, send_properties=False)
        self._unread = rr.binary_stream(self._stream)
        self._viewer_parts: dict[Part, Hashable] = {}
        self._schemas: dict[Part, pa.Schema] = {}
        self._unknown = not fresh
        """Whether the viewer may have parts that are not in `_viewer_parts`."""

    def differs(self, scene: Scene) -> bool:
        """Returns whether the viewer shows anything else than this scene."""
        return self._unknown or self._viewer_parts != self._versions(scene)

    def write(self, scene: Scene, serial: int) -> bytes:
        """Writes the changes from the viewer's frame to this one, and a row on `STAGE` that marks their end."""
        with self._lock:
            return self._write(scene, serial)

    def close(self) -> None:
        with self._lock:
            self._unread.read(flush_timeout_sec=FLUSH_S)  # otherwise Rerun warns on the terminal of unread data
            self._stream.disconnect()

    def _write(self, scene: Scene, serial: int) -> bytes:
        versions = self._versions(scene)
        if self._unknown:
            self._hold({**self.source.any_of_each_part(), **self.source.overlay.parts})
        for part in self._viewer_parts.keys() - versions.keys():
            self._send(_emptied(self._schemas[part]))
        for part, version in versions.items():
            if self._viewer_parts.get(part) != version and (columns := self._shown(part, version)) is not None:
                self._schemas[part] = columns.schema
                self._send(columns)
        self._viewer_parts, self._unknown = versions, False
        rows = rr.Scalars.columns(scalars=[float(serial)])
        self._put(Chunk.from_columns(STAGE, [rr.TimeColumn(STAGE, sequence=[serial])], rows))
        return messages(self._unread.read(flush_timeout_sec=FLUSH_S))

    def _hold(self, versions: Mapping[Part, Hashable]) -> None:
        """Assumes that the viewer has an unknown value of each of these parts."""
        for part, version in versions.items():
            if (columns := self._shown(part, version)) is not None:
                self._schemas[part], self._viewer_parts[part] = columns.schema, None

    def _versions(self, scene: Scene) -> dict[Part, Hashable]:
        return {**scene.versions, **self.source.overlay.at(scene.index)}

    def _shown(self, part: Part, version: Hashable) -> pa.RecordBatch | None:
        if isinstance(version, Drawn):
            return version.columns
        columns = self.source.value(part, version)
        return _decoded(columns) if columns is not None and part[1] == IMAGE else columns

    def _send(self, columns: pa.RecordBatch) -> None:
        for chunk in Chunk.from_record_batch(columns, index=None):  # with new ids: the newest static value counts
            self._put(chunk)

    def _put(self, chunk: Chunk) -> None:
        rr.send_chunks(chunk, recording=self._stream)


def archetype_of(columns: pa.RecordBatch) -> str:
    """Returns the archetype of a chunk that was made from one value."""
    return next(field.name.partition(":")[0] for field in columns.schema if ":" in field.name)


def columns_of(path: str, value: rr.AsComponents) -> pa.RecordBatch:
    """A value as it is logged, as columns of one row."""
    columns = [each.partition([len(each.as_arrow_array())]) for each in value.as_component_batches()]  # type: ignore[union-attr]
    return Chunk.from_columns(path, [], columns).to_record_batch()


def _emptied(schema: pa.Schema) -> pa.RecordBatch:
    return pa.record_batch([pa.array([[]], type=field.type) for field in schema], schema)


def _decoded(columns: pa.RecordBatch) -> pa.RecordBatch:
    """The pixels of an encoded image: the viewer decodes images in the background, and draws an older one meanwhile."""
    path = columns.schema.metadata[b"rerun:entity_path"].decode()
    blob = columns.column(f"{IMAGE}:blob")[0].values[0].values
    image = cv2.imdecode(np.asarray(blob, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:  # it was damaged on the disk
        return _emptied(columns.schema)
    if image.ndim == 3:
        image = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
    value = rr.Image(image, color_model="L" if image.ndim == 2 else "RGB")
    return components_of(columns_of(path, value), "Image")
