"""landmarks.npz: each method's landmarks, the observations of its keyframes, and its lines of the scene."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from zipfile import ZipFile, ZipInfo

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.io.files import require_file
from ispom.io.values import LARGEST
from ispom.types import FrameName, Landmarks, Trajectory, WorldLines

MAX_BYTES = 1 << 30
"""Largest size of the unpacked arrays."""
SMALL_BYTES, MAX_COMPRESSION = 64 << 20, 60
"""Largest compression ratio of a file that unpacks to more than SMALL_BYTES: files of `ispom run` have about 3."""
ROTATION_TOLERANCE = 1e-3
"""Largest deviation of R R^T from the identity."""
CAMERAS: tuple[FrameName, ...] = ("video", "left")
_SHAPES = {
    "ids": ("m", "i"),
    "xyz_in_world": ("m3", "f"),
    "rgb": ("m3", "u"),
    "key_times_ns": ("k", "i"),
    "key_rotations": ("k33", "f"),
    "key_translations": ("k3", "f"),
    "seen_from": ("n", "i"),
    "seen_ids": ("n", "i"),
    "seen_uv": ("n2", "f"),
}
"""Axes and kind of number of each array of a method; equal letters are equal sizes."""
_LINE_SHAPES = {"line_xyz": ("l23", "f"), "line_group": ("l", "i")}
"""The same for the arrays of methods with a map of lines, or of tags."""


@dataclass(frozen=True, eq=False)
class SceneMap:
    """One method's map, in its own world and unit."""

    landmarks: Landmarks
    key_frames: Trajectory
    """(K) world_from_CAMERA of the keyframes; its `frame` is the camera."""
    seen_from: NDArray[np.int64]
    """(N,) index of each observation's keyframe."""
    seen_ids: NDArray[np.int64]
    """(N,) id of each observation's point, including points without a position."""
    seen_uv: NDArray[np.float32]
    """(N, 2) [px] of each observation."""
    lines: WorldLines = field(default_factory=WorldLines.empty)
    """The lines of the final map."""


def map_bytes(maps: Mapping[str, SceneMap]) -> bytes:
    """Returns the file's content: compressed arrays called METHOD.NAME, no pickles."""
    arrays: dict[str, np.ndarray] = {}
    for method, method_map in maps.items():
        keys, points = method_map.key_frames, method_map.landmarks
        values = (
            points.ids,
            points.xyz_in_world.astype(np.float32),
            points.rgb,
            keys.times_ns,
            keys.rotations,
            keys.translations,
        )
        values += (method_map.seen_from, method_map.seen_ids, method_map.seen_uv)
        arrays |= {f"{method}.{name}": value for name, value in zip(_SHAPES, values, strict=True)}
        arrays[f"{method}.camera"] = np.array(CAMERAS.index(keys.frame))
        if len(method_map.lines):
            line_values = method_map.lines.xyz_in_world, method_map.lines.group
            arrays |= {f"{method}.{name}": value for name, value in zip(_LINE_SHAPES, line_values, strict=True)}
    out = BytesIO()
    np.savez_compressed(out, **arrays)  # type: ignore[arg-type]
    return out.getvalue()


def read_maps(path: Path) -> dict[str, SceneMap]:
    """Reads the maps by method. Raises InputError where the file is missing, damaged, or claims an implausible size.

    All sizes are checked before memory is allocated for any of the arrays.
    """
    size = require_file(path)
    try:
        with ZipFile(path) as packed:
            claimed = sum(_claimed_bytes(packed, entry) for entry in packed.infolist())
        if claimed > min(MAX_BYTES, max(SMALL_BYTES, MAX_COMPRESSION * size)):
            raise InputError(f"{path} unpacks to {claimed >> 20} MB, more than such a file holds: run again")
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        methods = dict.fromkeys(name.rpartition(".")[0] for name in arrays)
        present = {m: (*_SHAPES, "camera", *(_LINE_SHAPES if f"{m}.line_xyz" in arrays else ())) for m in methods}
        return {method: _map({n: arrays[f"{method}.{n}"] for n in names}) for method, names in present.items()}
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): check its permissions") from None
    except Exception:  # zip, zlib and NumPy's header parser raise a dozen kinds on damaged bytes
        raise InputError(f"{path} is damaged, or was not written by ispom run: run again") from None


def _claimed_bytes(packed: ZipFile, entry: ZipInfo) -> int:
    """Returns the unpacked size of one array. Raises ValueError where the archive and the array's own header differ."""
    with packed.open(entry) as file:
        version = np.lib.format.read_magic(file)
        if version == (1, 0):
            shape, _, dtype = np.lib.format.read_array_header_1_0(file)
        else:
            shape, _, dtype = np.lib.format.read_array_header_2_0(file)
        if dtype.hasobject or file.tell() + math.prod(shape) * dtype.itemsize != entry.file_size:
            raise ValueError(entry.filename)
    return entry.file_size


def _map(arrays: dict[str, np.ndarray]) -> SceneMap:
    """Raises ValueError where shapes or kinds do not agree."""
    counts: dict[str, int] = {}
    shapes = _SHAPES | (_LINE_SHAPES if "line_xyz" in arrays else {})
    for name, (axes, kind) in shapes.items():
        array = arrays[name]
        expected = (counts.setdefault(axes[0], len(array)), *(int(n) for n in axes[1:]))
        if array.shape != expected or array.dtype.kind != kind:
            raise ValueError(name)
        if kind == "f" and array.size and not -LARGEST <= array.min() <= array.max() <= LARGEST:  # NaN is neither
            raise ValueError(name)
    if counts["n"] and not 0 <= arrays["seen_from"].min() <= arrays["seen_from"].max() < counts["k"]:
        raise ValueError("seen_from")
    if (np.diff(arrays["ids"]) <= 0).any() or (np.diff(arrays["key_times_ns"]) <= 0).any():
        raise ValueError("not in order")
    turns = arrays["key_rotations"]
    if counts["k"] and abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max() > ROTATION_TOLERANCE:
        raise ValueError("key_rotations")
    if arrays["camera"].shape or arrays["camera"] not in range(len(CAMERAS)):
        raise ValueError("camera")
    return SceneMap(
        Landmarks(arrays["ids"], arrays["xyz_in_world"], arrays["rgb"]),
        Trajectory(
            arrays["key_times_ns"],
            arrays["key_rotations"],
            arrays["key_translations"],
            CAMERAS[int(arrays["camera"])],
        ),
        arrays["seen_from"],
        arrays["seen_ids"],
        arrays["seen_uv"],
        WorldLines(arrays["line_xyz"], arrays["line_group"]) if "line_xyz" in arrays else WorldLines.empty(),
    )
