"""A recording without a run's folder: its frames, and the quantities that its plots have."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from rerun.chunk import RrdReader

from ispom.errors import InputError, UnreadableImage
from ispom.geometry import Pose
from ispom.methods import Config, names
from ispom.types import Kind, Rig, Sequence, Trajectory

from ...engine.history.quantities import STEP_QUANTITIES
from ...engine.history.quantity import Value
from ...engine.history.record import ExposureRecord
from ...engine.playback import Playback
from ...views.rerun.recorder import START, START_NS
from ...views.rerun.rrd import require_readable
from ...views.rerun.streams import APPLICATION
from .records import MOST
from .stored import Stored, nobody

EACH = "/decisions"
"""An entity that every frame has."""
TRUE_RIG = "/world/truth/rig"
LATEST_NS = 2**62
"""A time in the year 2116, later than any frame."""
PLOTTED = {
    "plots/error/{}": "error_m",
    "plots/scale/{}/transferred": "scale",
    "plots/inliers/{}": "inliers",
    "plots/residual/{}": "residual_median_px",
}
"""Quantities by the entity of their plot."""
IMAGES = ("video", "left", "right")
"""Cameras whose images a recording may have."""
BLOB = "EncodedImage:blob"
NO_VALUES: Mapping[str, Value] = {quantity.key: None for quantity in STEP_QUANTITIES}
ValuesByFrame = dict[int, dict[str, dict[str, Value]]]
"""By frame, method and key."""


def read_recording(path: Path) -> Stored:
    """Returns a finished recording for review. InputError where the file is none, or of another version of Rerun."""
    recording_id = identity(path)
    times_ns, stereo, values = _contents(path)
    if not len(times_ns):
        raise InputError(f"{path} holds no exposure: give another recording")
    unavailable = f"{path.name} is a recording alone: nothing can be computed anew"

    def load(i: int) -> NoReturn:
        raise UnreadableImage(unavailable)

    kinds: tuple[Kind, ...] = tuple("stereo" if i in stereo else "video" for i in range(len(times_ns)))
    notes = (f"{unavailable}; of its quantities, those in its plots are known",)
    sequence = Sequence(path.stem, Rig(), times_ns, kinds, load, _truth(path, times_ns), notes)
    methods = tuple(name for name in names() if any(name in row for row in values.values()))
    return Stored(
        path,
        Playback(sequence, (), Config(), nobody),
        lambda: (
            ExposureRecord(i, int(times_ns[i]), kinds[i], (), {}, {}, {}, stored=values.get(i, {}))
            for i in range(len(times_ns))
        ),
        {},
        methods,
        path,
        recording_id,
        unavailable,
        _image_sizes(path),
    )


def identity(path: Path) -> str:
    """Returns the recording's id, which viewers use. InputError as `read_recording`."""
    require_readable(path)
    try:
        found = [store for store in RrdReader(path).recordings() if store.application_id == APPLICATION]
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f"{path} is damaged ({error}): give another recording") from None
    if len(found) != 1:
        raise InputError(f"{path} is no recording of one ispom run: open it with Rerun's own viewer")
    return found[0].recording_id


def _contents(path: Path) -> tuple[np.ndarray, frozenset[int], ValuesByFrame]:
    """Time of each frame (N,) [ns], those that are stereo pairs, and what was plotted."""
    times = dict(_rows(path, EACH, "time"))
    first = min(times.values(), default=0) - _start_ns(path)
    if min(times, default=0) < 0 or max(times, default=0) >= MOST:
        raise InputError(f"{path} has frames that are not as `ispom run` counts them: give another recording")
    times_ns = np.zeros(max(times, default=-1) + 1, np.int64)
    for index in range(len(times_ns)):
        times_ns[index] = times[index] - first if index in times else times_ns[index - 1]
    stereo = frozenset(index for index, _ in _rows(path, "/left/tracks"))
    values: ValuesByFrame = {}
    for name in names():
        for entity, key in PLOTTED.items():
            for index, value in _rows(path, "/" + entity.format(name), "Scalars:scalars"):
                if value is not None and len(value):
                    values.setdefault(index, {}).setdefault(name, dict(NO_VALUES))[key] = float(value[0])
    return times_ns, stereo, values


def _image_sizes(path: Path) -> dict[str, tuple[int, int]]:
    """Width and height of the first image that can be read of each camera."""
    found: dict[str, tuple[int, int]] = {}
    for camera in IMAGES:
        for _, blob in _rows(path, f"/{camera}/image", BLOB):
            if blob is not None and len(blob):
                content = BytesIO(np.asarray(blob[0], np.uint8).tobytes())
                with suppress(OSError, ValueError), Image.open(content) as image:
                    found[camera] = image.size
                break
    return found


def _start_ns(path: Path) -> int:
    """The first frame's time; 0 where it is not recorded."""
    try:
        for chunk in RrdReader(path).stream().filter(content=f"/{START}").to_chunks():
            batch = chunk.to_record_batch()
            if START_NS in batch.schema.names and (starts_ns := batch.column(START_NS).to_pylist()[0]):
                return int(np.clip(starts_ns[0], 0, LATEST_NS))
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f"{path} is damaged ({error}): give another recording") from None
    return 0


def _truth(path: Path, times_ns: NDArray[np.int64]) -> Trajectory | None:
    """shared_world_from_rig, where it was drawn: in single precision."""
    turned = dict(_rows(path, TRUE_RIG, "Transform3D:mat3x3"))
    poses: list[tuple[int, Pose]] = []
    for index, moved in _rows(path, TRUE_RIG, "Transform3D:translation"):
        if 0 <= index < len(times_ns) and moved is not None and turned.get(index) is not None:
            columns = np.array(turned[index][0], float).reshape(3, 3)
            poses.append((int(times_ns[index]), Pose(columns.T, np.array(moved[0], float))))
    return Trajectory.of(poses) if poses else None


def _rows(path: Path, entity: str, column: str = "exposure") -> Iterator[tuple[int, Any]]:
    """Frame, and the value of a column."""
    try:
        for chunk in RrdReader(path).stream().filter(content=entity):
            batch = chunk.to_record_batch()
            if {"exposure", column} <= set(batch.schema.names):
                values = batch.column(column).to_numpy(zero_copy_only=False).astype(object)
                yield from zip(batch.column("exposure").to_pylist(), values, strict=True)
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f"{path} is damaged ({error}): give another recording") from None
