"""`sequence.yaml`: a user's own rig. It names the cameras' streams, their clocks, `rig.yaml`, and the ground truth.

    name: roof, second flight        # optional
    rig: rig.yaml                    # optional; this is the default; also [intrinsics.yml, extrinsics.yml] of OpenCV
    video: {source: video.mp4, rate_hz: 30, offset_s: 0.012}
    left: {source: left, times: left.txt}
    right: {source: right, times: right.txt}
    truth: truth.tum                 # optional, world_from_rig, of any known program

A source is a folder of images or a video file. Where its images hold those of two cameras, `half` (left, right, top or
bottom) says which part is the camera's: `left: {source: film.avi, half: top}`. Left and right images need not be
rectified; those of times that differ by less than 2 ms are a pair; of folders without times, those of one number or
time in their names. Where no video is named, left images are the video, too, as in other stereo recordings.

A folder with the folders `left` and `right` (or `L` and `R`), or the films left.mp4 and right.mp4, and a rig.yaml needs
no sequence.yaml; `times.txt` in it holds the times of both.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.io.calibrations.recognised import one_rig
from ispom.io.camera import CLOCK_KEYS
from ispom.io.files import exists, is_folder, names
from ispom.io.mapping import read_mapping
from ispom.io.poses.recognised import read_trajectory
from ispom.sequences.formats.folder import TIMES, first_image, holds_images, named_images
from ispom.sequences.formats.streams import HALVES, StreamInput, streams
from ispom.sequences.formats.video import looks_like_video
from ispom.sequences.guess import size_of_photo
from ispom.sequences.matching import no_truth_note, truth_at
from ispom.sequences.recording import Recording
from ispom.sequences.sidecars import truth_of_images, used
from ispom.sequences.stereo_stream import StereoStream, stereo_stream
from ispom.sequences.stream import Stream, clock_of, fitted, named_file, size_of
from ispom.types import Frame, Kind, Measurement, Rig, Sequence, Trajectory

FILE = "sequence.yaml"
ENTRIES = ("name", "rig", "video", "left", "right", "truth")
STREAMS = ("video", "left", "right")
STREAM_ENTRIES = ("source", "half", *CLOCK_KEYS)


def looks_described(path: Path) -> bool:
    """Checks whether it is a folder with a sequence.yaml, or such a file by its content: not a calibration. Raises
    InputError where it is no YAML."""
    if is_folder(path):
        return exists(path / FILE) or _is_pair(path)
    if not is_yaml(path):
        return False
    content = read_mapping(path)
    named = [content[name] for name in STREAMS if name in content]
    return any(isinstance(entry, str) or (isinstance(entry, dict) and "source" in entry) for entry in named)


def is_yaml(path: Path) -> bool:
    """Checks the suffix of a path."""
    return path.suffix.lower() in (".yaml", ".yml")


def filmed_rig(path: Path, placed: bool = True) -> Rig:
    """Returns the rig of a file (also of another program), whose pair may not be rectified.

    Unless all cameras must be `placed`, the pose of a rig.yaml's video camera may be missing, and is then that of the
    rig.
    """
    return _filmed_rig(path, placed)[0]


def _filmed_rig(path: Path, placed: bool) -> tuple[Rig, tuple[str, ...]]:
    """Returns the same, with notes about skipped entries and likely mistakes."""
    path = path / FILE if is_folder(path) else path
    content = read_mapping(path) if exists(path) else {}
    rig_files = content.get("rig", "rig.yaml")
    files = tuple(
        named_file(path, "rig", name)
        for name in (rig_files if isinstance(rig_files, list) and rig_files else [rig_files])
    )

    def size() -> tuple[int, int]:
        """Returns the size of the images of the first stream that is a folder."""
        first = _sides(path.parent)[0] if not content else "left"
        entry = next((content[name] for name in ("left", "video") if name in content), first)
        folder = named_file(path, "source", entry.get("source") if isinstance(entry, dict) else entry)
        if not is_folder(folder):
            raise InputError(f"{files[0]}: image_width and image_height are missing: add them")
        return size_of_photo(folder / named_images(folder).names[0])

    return one_rig(files, placed, size)


def _is_pair(folder: Path) -> bool:
    return bool(_sides(folder))


def _sides(folder: Path) -> tuple[str, ...]:
    """Returns the names of the folders of images, or with a rig.yaml also of the films, of a pair; none without one."""
    if all(holds_images(folder / side) for side in ("left", "right")):
        return ("left", "right")
    if not exists(folder / "rig.yaml"):
        return ()
    if all(holds_images(folder / side) for side in ("L", "R")):
        return ("L", "R")
    there = names(folder)
    films = [[name for name in there if name.lower().startswith(f"{side}.")] for side in ("left", "right")]
    films = [[name for name in each if looks_like_video(folder / name)] for each in films]
    return tuple(each[0] for each in films) if all(len(each) == 1 for each in films) else ()


def open_described(path: Path, placed: bool = True) -> Sequence | Recording:
    """Opens a sequence.yaml, or the folder that contains one; returns a recording if no video stream is named.

    Raises InputError that names the missing or invalid file and the entry. `placed` as in `filmed_rig`.
    """
    path = path / FILE if is_folder(path) else path
    content = read_mapping(path) if exists(path) else _of_pair(path.parent)
    _refuse_others(path, "", content, ENTRIES)
    name = content.get("name", path.resolve().parent.name)
    if not isinstance(name, str) or not name.isprintable():
        raise InputError(f"{path}: name is not a line of text: put it in quotation marks")
    if ("left" in content) != ("right" in content):
        raise InputError(f"{path} names only one of left and right: name both, or call the one camera video")
    no_camera = f"{path} names no camera: add video, or left and right, or all three"
    if "video" not in content and "left" not in content:
        raise InputError(no_camera)
    rig, notes = _filmed_rig(path, placed)
    rig, scaled = _fitted_rig(path, content, rig)
    notes += scaled
    streams_by_name = streams(
        path, {name: _stream_input(path, name, content, rig) for name in STREAMS if name in content}
    )
    video, stereo = streams_by_name.get("video"), None
    if "left" in content:
        stereo = stereo_stream(path, rig, streams_by_name["left"], streams_by_name["right"])
    truth, about_truth = None, ()
    if "truth" in content:
        first = video or streams_by_name["left"]
        truth, about_truth = _truth(named_file(path, "truth", content["truth"]), first.times_ns)
    if video is not None:
        opened = _sequence(name, rig, video, stereo, truth)
    elif stereo is not None:
        opened = _recording(name, stereo, truth)
    else:
        raise InputError(no_camera)
    files = [("lens", path.parent / "rig.yaml"), ("truth", path.parent / str(content.get("truth", "")))]
    found = used(*((what, file) for what, file in files if exists(file) and not is_folder(file)))
    opened = replace(opened, notes=notes + opened.notes + about_truth, found=found)
    if truth is None:
        return opened
    return replace(opened, notes=opened.notes + no_truth_note(path.parent / content["truth"], opened.truth))


def _truth(path: Path, times_ns: NDArray[np.int64]) -> tuple[Trajectory | None, tuple[str, ...]]:
    """Returns world_from_rig at the file's own times, or those of the images where it has none, and notes. Raises
    InputError for a file that is invalid, ambiguous, or has neither times nor a pose for each image."""
    file = read_trajectory(path)
    if not file.timed or not file.has_rotations:
        truth, notes = truth_of_images(path, times_ns, (), "rig")
        if truth is None:
            raise InputError(f"{notes[-1]}: give a file with times and rotations")
        return truth, notes
    trajectory, notes = replace(file.trajectory, frame="rig"), file.notes
    last = np.append(np.diff(trajectory.times_ns) > 0, True)  # of several poses at one time the last is used
    return trajectory.select(last), notes


def _of_pair(folder: Path) -> dict[Any, Any]:
    """Returns the content of a sequence.yaml for a folder with left and right images."""
    if not exists(folder / "rig.yaml"):
        raise InputError(
            f"{folder} has left and right images, but no rig.yaml: make it with `ispom calibrate stereo`, or write it"
        )
    times = {"times": TIMES} if exists(folder / TIMES) else {}
    return {side: {"source": source, **times} for side, source in zip(("left", "right"), _sides(folder), strict=True)}


def _recording(name: str, stereo: StereoStream, truth: Trajectory | None) -> Recording:
    rig, ground_truth = stereo.rig, None
    if truth is not None:
        ground_truth = truth_at(truth.moved(right=rig.rig_from_left, frame="left"), stereo.times_ns)
    laser = None if rig.rig_from_laser is None else rig.rig_from_left.inverse() @ rig.rig_from_laser
    return Recording(
        name, rig.camera("left"), rig.baseline_m, stereo.times_ns, stereo.read, ground_truth, stereo.notes, laser,
        rig.video_sigma, rig.pair_sigma,
    )  # fmt: skip


def _sequence(name: str, rig: Rig, video: Stream, stereo: StereoStream | None, truth: Trajectory | None) -> Sequence:
    plan: list[tuple[int, Kind, int]] = [(t, "video", i) for i, t in enumerate(video.times_ns.tolist())]
    notes = video.notes
    if stereo is None:
        rig = rig.changed(left=None, right=None)
    else:
        rig, notes = stereo.rig, notes + stereo.notes
        both: list[tuple[int, Kind, int]] = [(t, "stereo", i) for i, t in enumerate(stereo.times_ns.tolist())]
        plan = sorted(both + plan)  # a stereo pair comes before the video frame of the same time, as in the alphabet

    def load(index: int) -> Measurement:
        time_ns, kind, i = plan[index]
        if stereo is None or kind == "video":
            return Frame.video(time_ns, video.read(i))
        return Frame.stereo(time_ns, stereo.read("left", i), stereo.read("right", i))

    times_ns = np.array([t for t, _, _ in plan], np.int64)
    ground_truth = truth_at(truth, np.unique(times_ns)) if truth is not None else None
    return Sequence(name, rig, times_ns, tuple(kind for _, kind, _ in plan), load, ground_truth, notes)


def _fitted_rig(path: Path, content: dict[Any, Any], rig: Rig) -> tuple[Rig, tuple[str, ...]]:
    """Returns the rig for the size of the images of each stream, where they are in a folder, with a note about each
    camera that was scaled. Raises InputError as `fitted`."""
    notes: tuple[str, ...] = ()
    for name in STREAMS:
        entry, camera = content.get(name), getattr(rig, name)
        source = entry.get("source") if isinstance(entry, dict) else entry
        if camera is None or not isinstance(source, str) or not is_folder(path.parent / source):
            continue
        first = first_image(named_file(path, f"{name}.source", source))
        if first is None:
            continue
        width, height = size_of_photo(first)
        half = entry.get("half") if isinstance(entry, dict) else None
        size = width // (1 + (half in ("left", "right"))), height // (1 + (half in ("top", "bottom")))
        camera, scaled = fitted(path, camera, size)
        rig, notes = (rig.changed(**{name: camera}), (*notes, *scaled)) if scaled else (rig, notes)
    return rig, notes


def _stream_input(path: Path, camera: str, content: dict[Any, Any], rig: Rig) -> StreamInput:
    entry = content[camera]
    entry = {"source": entry} if isinstance(entry, str) else entry
    if not isinstance(entry, dict):
        raise InputError(f"{path}: {camera} must name a folder of images or a video file: correct it")
    _refuse_others(path, f"{camera}.", entry, STREAM_ENTRIES)
    described = getattr(rig, camera)
    if described is None:
        raise InputError(f"{path} has a {camera} stream, but its rig no {camera} camera: add it to the rig's file")
    source, clock = named_file(path, f"{camera}.source", entry.get("source")), clock_of(path, entry, f"{camera}.")
    half = entry.get("half")
    if half is not None and half not in HALVES:
        raise InputError(f"{path}: {camera}.half is {str(half)[:40]}, give one of {', '.join(HALVES)}")
    if is_folder(source):
        return StreamInput(source, size_of(described), clock, named_images(source), half)
    if not looks_like_video(source):
        raise InputError(f"{path}: {camera}.source names {source}, neither a folder nor a video file: correct it")
    return StreamInput(source, size_of(described), clock, None, half)


def _refuse_others(path: Path, where: str, values: dict[Any, Any], known: tuple[str, ...]) -> None:
    other = next((key for key in values if key not in known), None)
    if other is not None:
        raise InputError(f"{path}: {where}{other} is not known: use only {', '.join(known)}")
