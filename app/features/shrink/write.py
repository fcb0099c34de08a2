"""Writes a clip as a folder that `ispom run` opens: images that are copied pixel by pixel, calibration and times."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.io.files import names
from ispom.io.rig import rig_text
from ispom.io.whole import require_no_links, write_whole
from ispom.sensors.kind import Readings
from ispom.sequences.formats.described import FILE
from ispom.sequences.sensor_doubts import file_kinds, readings_of
from ispom.stop import check_stop
from ispom.types import Frame, Image, Rig, Sequence

from .cut import SENSORS

RIG_FILE, SENSOR_FILE = "rig.yaml", "sensors.yaml"
COLUMNS = {
    "rates": ("gx", "gy", "gz"),
    "forces": ("ax", "ay", "az"),
    "xyz": ("x", "y", "z"),
    "sigma": ("sigma_x", "sigma_y", "sigma_z"),
    "distances": ("distance",),
    "turns": ("turn",),
}
"""Columns of a sensor's table by the names of its readings; those of any other name are columns of that name."""
SINCE = (1980, 1, 1, 0, 0, 0)
"""Date of all files in a zip, so that the same clip gives the same bytes."""


def require_empty(folder: Path) -> None:
    """Makes the folder. Raises InputError where there is something in its place, or in it, or it is a link."""
    if folder.is_symlink():
        raise InputError(f"{folder} is a link: give a new or empty folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder} cannot be created ({error.strerror}): give another folder") from None
    if there := names(folder):
        raise InputError(f"{folder} is not empty (it holds {there[0]}): give a new or empty folder")


def write_recording(folder: Path, part: Sequence) -> None:
    """Writes images, times, calibration and other sensors into an empty folder. Raises InputError for sensors that no
    table holds, and where the disk does not take it."""
    streams = {name: _times_ns(part, kind) for kind, cameras in SENSORS.items() for name in cameras}
    streams = {name: times_ns for name, times_ns in streams.items() if len(times_ns)}
    content = {name: {"source": name, "times": f"{name}.txt"} for name in streams}
    _write(folder, FILE, yaml.safe_dump(content, sort_keys=False))
    for name, times_ns in streams.items():
        _write(folder, f"{name}.txt", "".join(f"{_seconds(t)}\n" for t in times_ns.tolist()))
    _write_rig(folder, part)
    numbers = dict.fromkeys(streams, 0)
    for measured in map(part.load, range(len(part))):
        check_stop()
        for name, image in measured.images.items() if isinstance(measured, Frame) else ():
            _write(folder, f"{name}/{numbers[name]:06d}.png", png(image))
            numbers[name] += 1


def has_sensors(folder: Path) -> bool:
    """Whether a written clip has other sensors than cameras."""
    return SENSOR_FILE in names(folder)


def zipped(folder: Path) -> bytes:
    """Returns a folder as a zip file, whose entries are in the folder's name."""
    out = BytesIO()
    with ZipFile(out, "w", ZIP_DEFLATED) as archive:
        for path in sorted(p for p in folder.rglob("*") if p.is_file() and not p.is_symlink()):
            name = f"{folder.resolve().name}/{path.relative_to(folder).as_posix()}"
            archive.writestr(ZipInfo(name, SINCE), path.read_bytes(), ZIP_DEFLATED)
    return out.getvalue()


def png(image: Image) -> bytes:
    """Returns a grey or RGB image without loss."""
    return cv2.imencode(".png", image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1].tobytes()


def _write_rig(folder: Path, part: Sequence) -> None:
    others = {name: None for name in part.rig.sensors if name not in part.rig.cameras}
    _write(folder, RIG_FILE, rig_text(part.rig.changed(**others)))
    if not others:
        return
    for name, sensor in part.rig.sensors.items():
        if name in others and sensor.kind not in file_kinds():
            raise InputError(f"{part.name} has a sensor {name} of the kind {sensor.kind}, of which no table is written")
    entries = yaml.safe_load(rig_text(Rig({name: part.rig.sensors[name] for name in others})))
    for name, found in readings_of(part).items():
        _write(folder, f"{name}.csv", table(found))
        entries[name]["file"] = f"{name}.csv"
    entries = {name: {"sensor": name, **entry} for name, entry in entries.items() if "file" in entry}
    if entries:
        _write(folder, SENSOR_FILE, yaml.safe_dump(entries, sort_keys=False))


def table(found: Readings) -> str:
    """Returns the readings of a sensor as a table that `--sensors` reads. Raises InputError where no table holds
    them."""
    columns = {
        name: column
        for key, values in found.values.items()
        for name, column in zip(COLUMNS.get(key, (key,)), np.atleast_2d(values.T), strict=False)
    }
    if not columns or any(len(column) != len(found) for column in columns.values()):
        raise InputError(f"measurements of the kind {found.kind} are written to no table: choose other methods")
    rows = np.stack([*columns.values()], axis=1)
    if found.between:  # a row spans the time from the row before
        rows = np.vstack([np.zeros(len(columns)), rows])
    lines = [",".join([str(t), *(repr(float(v)) for v in row)]) for t, row in zip(found.times_ns, rows, strict=True)]
    return "\n".join([",".join(["time_ns", *columns]), *lines, ""])


def _times_ns(part: Sequence, kind: str) -> NDArray[np.int64]:
    return part.times_ns[np.array([each == kind for each in part.kinds], bool)]


def _seconds(time_ns: int) -> str:
    """All digits, as no floating-point number has them."""
    sign, rest = ("-", -time_ns) if time_ns < 0 else ("", time_ns)
    return f"{sign}{rest // 10**9}.{rest % 10**9:09d}"


def _write(folder: Path, name: str, content: str | bytes) -> None:
    path = folder / name
    require_no_links(folder, path)
    write_whole(path, content)
