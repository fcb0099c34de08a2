"""Opens a source of measurements: a simulation, a live camera, or a recording whose format is recognised."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from ispom.errors import InputError, as_text, counted
from ispom.io.calibrations.pair import unit_note
from ispom.io.files import bounded, confined, confinement, exists, expanded, is_folder, names
from ispom.plausibility import Doubt
from ispom.sequences.address import MAX_SEED
from ispom.sequences.format import FORMATS, Format, format_of
from ispom.sequences.format import opened as format_opened
from ispom.sequences.formats.bags import BAG_SUFFIXES, looks_like_bag, open_bag
from ispom.sequences.formats.described import is_yaml, looks_described, open_described
from ispom.sequences.formats.euroc import looks_like_euroc, open_euroc
from ispom.sequences.formats.feature_table import looks_like_feature_table, open_feature_table
from ispom.sequences.formats.folder import looks_like_images, open_folder, unread_images
from ispom.sequences.formats.four_seasons import looks_like_four_seasons, open_four_seasons
from ispom.sequences.formats.kitti import looks_like_kitti, open_kitti
from ispom.sequences.formats.kitti_360 import looks_like_kitti_360, open_kitti_360
from ispom.sequences.formats.kitti_raw import looks_like_kitti_raw, open_kitti_raw
from ispom.sequences.formats.live import looks_live, open_live
from ispom.sequences.formats.published import looks_like_published, open_published
from ispom.sequences.formats.robotcar import looks_like_robotcar, open_robotcar
from ispom.sequences.formats.scenario import looks_like_scenario
from ispom.sequences.formats.seven_scenes import looks_like_seven_scenes, open_seven_scenes
from ispom.sequences.formats.tartanair import looks_like_tartanair, open_tartanair
from ispom.sequences.formats.tum import looks_like_tum, open_tum
from ispom.sequences.formats.vamr import looks_like_malaga, looks_like_parking, open_malaga, open_parking
from ispom.sequences.formats.video import VIDEO_SUFFIXES, looks_like_video, open_video
from ispom.sequences.formats.video_folder import chapters_in, join_line, looks_like_video_folder, open_video_folder
from ispom.sequences.formats.vslam_lab import looks_like_vslam_lab, open_vslam_lab
from ispom.sequences.panoramic import with_faces
from ispom.sequences.policy import ANY_SOURCE, SourcePolicy
from ispom.sequences.prefetch import prefetched
from ispom.sequences.readable import require_readable
from ispom.sequences.recorded_sensors import AUTO, NONE, RecordedSensor, with_recorded_sensors
from ispom.sequences.recording import Recording
from ispom.sequences.sensor_doubts import with_doubts
from ispom.sequences.stream import scaled_calibrations
from ispom.sequences.two_rate import MAX_FRAMES, check_shape, two_rate
from ispom.types import FRAME_KINDS, Found, Measurement, Sequence

MIN_FRAMES = 3
"""Least number of frames of a run: an alignment of its trajectory needs three positions."""
Topics = tuple[str, ...]
Looks = Callable[[Path], bool]
LAYOUTS: dict[Looks | None, Callable[[Path], Recording | Sequence]] = {
    looks_described: open_described,
    looks_like_kitti: open_kitti,
    looks_like_kitti_raw: open_kitti_raw,
    looks_like_kitti_360: open_kitti_360,
    looks_like_four_seasons: open_four_seasons,
    looks_like_robotcar: open_robotcar,
    looks_like_vslam_lab: open_vslam_lab,  # before EuRoC, whose folder may still be there, without its images
    looks_like_euroc: open_euroc,
    looks_like_parking: open_parking,
    looks_like_malaga: open_malaga,
    looks_like_tartanair: open_tartanair,
    looks_like_feature_table: open_feature_table,
}
"""The function that opens each format, by the function that recognises it; the first that matches is used."""
ONE_CAMERA: dict[Looks | None, Callable[[Path, Path | None], Recording]] = {
    looks_like_bag: open_bag,
    looks_like_tum: open_tum,
    looks_like_seven_scenes: open_seven_scenes,
    looks_like_video: open_video,
    looks_like_published: open_published,
    looks_like_images: open_folder,
    looks_like_video_folder: open_video_folder,
}
"""The same for formats whose calibration may be replaced by another file."""

ARCHIVES = frozenset({".zip", ".tar", ".gz", ".tgz", ".bz2", ".xz", ".7z", ".rar"})
SETTINGS = frozenset({".yaml", ".yml"})
"""Suffixes of files that belong to recordings."""
FILES = VIDEO_SUFFIXES | BAG_SUFFIXES | SETTINGS
"""Suffixes of files that can be opened."""


def check_max_exposures(count: int | None) -> None:
    """Raises InputError where the option is out of its range."""
    if count is not None and not MIN_FRAMES <= count <= MAX_FRAMES:
        raise InputError(f"--max-exposures is {str(count)[:40]}, give {MIN_FRAMES} or more, up to {MAX_FRAMES}")


def open_sequence(
    source: str,
    *,
    stereo_every: int = 1,
    video_scale: float = 1.0,
    seed: int = 0,
    max_exposures: int | None = None,
    camera: str | Path | None = None,
    scale_calibration: bool = False,
    policy: SourcePolicy = ANY_SOURCE,
    placed: bool = True,
    sensors: str | Path | None = AUTO,
    topics: Topics = (),
    cache_dir: Path | None = None,
) -> Sequence:
    """Opens a simulation, a live camera, or a recording. Raises InputError for an invalid source or option, and for a
    source that the `policy` does not allow.

    Args:
        source: `sim:NAME` (made from `seed`) or `sim:NAME#SEED`; a live camera, calibrated by the file `camera`; or a
            path whose format is recognised, shaped by `two_rate`.
        max_exposures: limits the sequence to its first frames.
        scale_calibration: scales a calibration to images of another size of the same shape.
        placed: requires poses of all cameras. Otherwise the pose of a rig's video camera may be missing, and is then
            that of the rig.
        sensors: other sensors: those in or beside the source ("auto"), those of a file (see
            `sequences.sensors_yaml`), or none ("none", or None).
        topics: topics of a bag: left=TOPIC and right=TOPIC, or video=TOPIC.
        cache_dir: replaces the user's cache folder, which contains images of simulations.
    """
    policy.check(source)
    if camera is not None and source.startswith("sim:"):
        raise InputError(f"{source} has its own calibration: leave --camera {camera} out")
    if topics and (source.startswith("sim:") or looks_live(source)):
        raise InputError(f"{source} is no bag: leave --topics out")
    check_max_exposures(max_exposures)
    check_shape(stereo_every, video_scale)
    if not 0 <= seed <= MAX_SEED:
        raise InputError(f"--seed is {seed}, give a value from 0 to {MAX_SEED}")
    calibration = None if camera is None else expanded(camera)
    choice = NONE if sensors is None else Path(sensors)
    own: tuple[RecordedSensor, ...] = ()
    if source.startswith("sim:"):
        from ispom.sequences.formats.simulated import open_words  # imports the ray caster, which takes seconds

        with bounded(policy.places):  # its words may name files: a route, a mesh
            sequence = open_words(source.removeprefix("sim:"), seed, cache_dir)
    elif looks_live(source):
        if choice not in (AUTO, NONE):
            raise InputError(f"{source} is a live camera, which takes in no files of sensors: leave --sensors out")
        return open_live(source, calibration, max_exposures, MIN_FRAMES)
    else:
        with bounded(policy.places), scaled_calibrations(scale_calibration):
            path = expanded(source)
            described = not placed and exists(path) and looks_described(path)
            opened = open_described(path, placed) if described else _opened(path, calibration, seed, topics)
        if isinstance(opened, Sequence):
            sequence = opened
        else:
            sequence, own = two_rate(opened, stereo_every, video_scale), opened.sensors
        sequence = _within(with_faces(sequence), policy)
    frames = max(map(sequence.kinds.count, FRAME_KINDS))
    if frames < MIN_FRAMES:
        few = counted(frames, "frame")
        raise InputError(f"{source} has {few}, a run needs {MIN_FRAMES} or more: give a longer sequence")
    if not source.startswith("sim:"):  # faults of a simulation are intended
        sequence = with_doubts(sequence.with_notes(_unit_notes(source, sequence)), source)
    sequence = replace(sequence, name=as_text(sequence.name))
    sequence = sequence if max_exposures is None else sequence.truncated(max_exposures)
    if sequence.prepare is None:  # images of simulations are made, not read
        require_readable(sequence)
    with bounded(policy.places):
        sequence = _with_sensors(sequence, own, choice)
    return prefetched(replace(sequence, notes=tuple(map(_as_text, sequence.notes))))


def _with_sensors(sequence: Sequence, own: tuple[RecordedSensor, ...], choice: Path) -> Sequence:
    """Returns the sequence with the other sensors of a file, or those of its own that can be used, or none."""
    if choice in (AUTO, Path()):  # the page's field is empty
        return with_recorded_sensors(sequence, own)
    if choice == NONE:
        why = "is not used, as --sensors is none"
        return sequence.with_found(Found(each.sensor.kind, each.where, False, why) for each in own)
    from ispom.sequences.sensors_yaml import with_sensors

    return with_sensors(sequence, expanded(choice), own)


def _as_text(note: str) -> str:
    return Doubt(note.key, as_text(note)) if isinstance(note, Doubt) else as_text(note)


def _unit_notes(source: str, sequence: Sequence) -> tuple[str, ...]:
    """Returns a note about a pair whose baseline is likely not in metres."""
    if not sequence.rig.has_stereo:
        return ()
    note = unit_note(sequence.rig.baseline_m)
    return (f"{source}: {note}",) if note and not any(note[:30] in other for other in sequence.notes) else ()


def _within(sequence: Sequence, policy: SourcePolicy) -> Sequence:
    """Returns the sequence with images that are read within the bounds of the policy, and of the current
    confinement."""
    places = confinement()
    if policy.places is None and places is None:
        return sequence

    def load(i: int) -> Measurement:
        with bounded(policy.places), confined(places):
            return sequence.load(i)

    return replace(sequence, load=load)


def _opened(path: Path, calibration: Path | None, seed: int, topics: Topics = ()) -> Recording | Sequence:
    if not exists(path):
        raise InputError(f"{path} does not exist: correct the path, or give a simulation such as sim:city")
    layout = layout_of(path)
    if layout is looks_like_bag:
        return open_bag(path, calibration, topics)
    if topics:
        raise InputError(f"{path} is no bag: leave --topics out")
    if isinstance(layout, Format):
        if calibration is not None:
            raise InputError(f"{path} has its own calibration: leave --camera {calibration} out")
        return format_opened(layout, path)
    if layout is looks_like_scenario:
        from ispom.sequences.formats.simulated import open_scenario_file  # brings the ray caster, which takes seconds

        return open_scenario_file(path, seed)
    if layout in ONE_CAMERA:
        return ONE_CAMERA[layout](path, calibration)
    if layout in LAYOUTS or (not is_folder(path) and is_yaml(path)):  # open_described reports missing entries
        if calibration is not None:
            raise InputError(f"{path} has its own calibration: leave --camera {calibration} out")
        return LAYOUTS.get(layout, open_described)(path)
    if not is_folder(path):
        if path.suffix.lower() in ARCHIVES:
            raise InputError(f"{path} is an archive: unpack it, and give the folder that it holds")
        raise InputError(
            f"{path} is a file of no known kind: give a video ({', '.join(sorted(VIDEO_SUFFIXES))}), a sequence.yaml, "
            "or the folder of a drive, such as kitti/sequences/06"
        )
    if not names(path):
        raise InputError(f"{path} is an empty folder: give the folder of a drive, such as kitti/sequences/06")
    if unread := unread_images(path):
        kinds = ", ".join(sorted({Path(name).suffix.lower() for name in unread}))
        count = counted(len(unread), "image")
        raise InputError(f"{path} holds {count} in a format that is not read ({kinds}): convert them to JPEG or PNG")
    if chapters := chapters_in(path):
        raise InputError(
            f"{path} holds {len(chapters)} chapters of one film ({', '.join(chapters[:3])}): join them there by "
            f"{join_line(chapters)}, and give whole.mp4; or give one chapter"
        )
    within = recordings_in(path)
    cure = f"give a recording in it, such as {within[0]}" if within else "give a folder or file of one of these kinds"
    raise InputError(
        f"{path} has no known layout (looked for image_0 and calib.txt, as in KITTI odometry, mav0, as in EuRoC, "
        f"rgb.txt, as in TUM, rgb.csv, as in VSLAM-LAB, frame-*.color.png, as in 7-Scenes, sequence.yaml, "
        f"imu_and_features.csv, files of images, and one video): {cure}"
    )


def recordings_in(folder: Path) -> list[Path]:
    """Returns the recordings in a folder that is none itself, by name, depth images last; without camera files."""
    inner = (p for pattern in ("*", "sequences/*") for p in folder.glob(pattern) if p.suffix.lower() not in SETTINGS)
    return sorted((p for p in inner if recognised(p)), key=lambda p: ("depth" in p.name.lower(), p))


def layout_of(path: Path) -> Looks | Format | None:
    """Returns the key of LAYOUTS or ONE_CAMERA, or the installed format, that recognises a folder or file; else None.

    Formats of packages are tried after the layouts with characteristic names, before images and videos. Raises
    InputError where the path cannot be read.
    """
    for looks in (looks_like_scenario, *LAYOUTS):
        if looks is not None and looks(path):
            return looks
    if (layout := format_of(path, is_folder(path))) is not None:
        return layout
    return next((looks for looks in ONE_CAMERA if looks is not None and looks(path)), None)


def recognised(path: Path) -> bool:
    """Checks whether a folder or file can be opened, by what `open_sequence` recognises it by; not what cannot be
    looked at, such as a link to nothing."""
    try:
        known = FILES.union(*(each.suffixes for each in FORMATS.items().values()))
        if path.suffix.lower() not in known and not is_folder(path):
            return False  # most files: nothing in them need be looked for
        return layout_of(path) is not None
    except InputError:
        return False
