"""`ispom sources`: what the program sees in a source, without running anything."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
import tyro
from numpy.typing import NDArray

from ispom.errors import printable
from ispom.methods import possible_methods
from ispom.sensors.kind import Readings
from ispom.sequences.sensor_doubts import file_kinds, frames_ns_of, readings_of
from ispom.types import Camera, Found, Kind, Sequence, Trajectory

from ...engine.options import Options


@dataclass(frozen=True, kw_only=True)
class Sources(Options):
    """Describes a source without running anything: cameras, calibration, rates, gaps, ground truth."""

    source: tyro.conf.Positional[str]
    """sim:NAME, a path (a data set's folder, images, a video file ...), or a live camera (camera:0, http://...)."""


GAP = 1.5
"""A time between frames is a gap from this many median times on."""
SHOWN_GAPS = 3
EARLIEST_DATE_NS = 1_000_000_000_000_000_000
"""Times from here on (2001) are dates; smaller ones count from the recording's own zero."""


def sources(options: Sources) -> int:
    """Prints the description; the exit code is 0. A live source is let go."""
    sequence = options.open(options.source)
    if sequence.stop is not None:
        sequence.stop()
    sys.stdout.write("\n".join(map(printable, described(sequence))) + "\n")
    return 0


def described(sequence: Sequence) -> list[str]:
    """Cameras with sizes, calibration, rates and gaps; span, truth, possible methods and notes, as lines. Decodes
    nothing."""
    rig, lines = sequence.rig, [sequence.name]
    kinds = np.array(sequence.kinds)
    if rig.video is not None:
        lines += _camera("video", rig.video, _rate(sequence.times_ns[kinds == "video"], "frames"))
    if rig.left is not None:
        what = f"baseline {rig.baseline_m:.4g} m, " if rig.has_stereo else ""
        lines += _camera("stereo", rig.left, what + _rate(sequence.times_ns[kinds == "stereo"], "pairs"))
    readings = readings_of(sequence)
    for name, sensor in rig.sensors.items():
        if name not in ("video", "left", "right"):
            what = _rate(sequence.times_ns[kinds == sensor.kind], "measurements")
            if sensor.kind in file_kinds():
                what = _measured(readings.get(name))
            lines += _camera(name, rig.camera(name), what) if name in rig.cameras else [_line(name, what)]
    lines.append(_line("span", _span(sequence.times_ns)))
    lines += [_line("gaps", text) for text in _gaps(sequence)]
    lines.append(_line("truth", _truth(sequence.truth, frames_ns_of(sequence))))
    lines.append(_line("methods", ", ".join(possible_methods(rig)) or "none: neither a video camera nor a stereo pair"))
    lines += _table(sequence.found)
    unused = {each.note for each in sequence.found if not each.used}
    return lines + [_line("note", note) for note in sequence.notes if note not in unused]


def _table(found: Iterable[Found]) -> list[str]:
    """What lies in or beside the source, what it holds, and what it is used for or why it is not."""
    rows = sorted(found, key=lambda each: not each.used)  # stable: those that are used come first
    wide = max((len(each.what) for each in rows), default=0)
    lines = []
    for number, each in enumerate(rows):
        word = "used" if each.used else "not used"
        why = f" ({each.why})" if each.used and each.why else "" if each.used else f" {each.why}"
        lines.append(_line("found" if number == 0 else "", f"{word:<9} {each.what:<{wide}} {each.where}{why}"))
    return lines


def _line(name: str, text: str) -> str:
    return f"  {name:<8}{text}"


def _camera(name: str, camera: Camera, what: str) -> list[str]:
    coefficients = ", ".join(f"{k:.4g}" for k in camera.distortion)
    distortion = f"distortion {coefficients}" if coefficients else "no distortion"
    if camera.lens != "opencv":
        distortion = f"{camera.lens}, {distortion}"
    calibration = f"fx {camera.fx:.2f}, fy {camera.fy:.2f}, cx {camera.cx:.2f}, cy {camera.cy:.2f} px, {distortion}"
    return [_line(name, f"{camera.width} x {camera.height} px, {what}"), _line("", calibration)]


def _measured(found: Readings | None) -> str:
    """The number of a sensor's measurements, however many of them are in one piece of the sequence, and their rate."""
    if found is None:
        return "0 measurements"
    return _rate(found.times_ns[len(found.times_ns) - len(found) :], "measurements")


def _rate(times_ns: NDArray[np.int64], unit: str) -> str:
    if len(times_ns) < 2:
        return f"{len(times_ns)} {unit}"
    steps_s = np.diff(times_ns) * 1e-9
    even = np.ptp(steps_s) <= 0.02 * np.median(steps_s)
    return f"{len(times_ns)} {unit}, {1 / np.median(steps_s):.4g} Hz" + ("" if even else " (median; not even)")


def _span(times_ns: NDArray[np.int64]) -> str:
    if not len(times_ns):
        return "nothing"
    first_ns, last_ns = int(times_ns[0]), int(times_ns[-1])
    start = f"from {first_ns * 1e-9:.3f} s"
    if first_ns >= EARLIEST_DATE_NS:
        start = f"from {datetime.fromtimestamp(first_ns // 10**9, UTC):%Y-%m-%d %H:%M:%S} UTC"
    return f"{(last_ns - first_ns) * 1e-9:.3f} s, {start}"


def _gaps(sequence: Sequence) -> list[str]:
    """The longest of each kind, or that there are none."""
    kinds, found = np.array(sequence.kinds), []
    names: tuple[tuple[Kind, str], ...] = (("video", "frames"), ("stereo", "pairs"))
    for kind, unit in names:
        times_ns = sequence.times_ns[kinds == kind]
        steps_ns = np.diff(times_ns)
        if not len(steps_ns):
            continue
        gaps = np.flatnonzero(steps_ns > GAP * np.median(steps_ns))
        longest = np.sort(gaps[np.argsort(-steps_ns[gaps], kind="stable")[:SHOWN_GAPS]])
        places = [f"{steps_ns[i] * 1e-9:.3f} s at {(times_ns[i] - sequence.times_ns[0]) * 1e-9:.3f} s" for i in longest]
        if len(gaps):
            found.append(f"{len(gaps)} between {unit}, the longest: {', '.join(places)}")
    return found or ["none"]


def _truth(truth: Trajectory | None, times_ns: NDArray[np.int64]) -> str:
    if truth is None or not len(truth):
        return "none: no errors can be computed"
    covered = np.isin(times_ns, truth.times_ns).sum()
    return f"at {covered} of {len(times_ns)} frames, path {truth.length:.3f} m"
