"""Finds the files of other sensors in or beside a recording: EuRoC's imu0, KITTI's oxts, tables, and Kalibr's files.

Noise is that of the file next to the measurements, or of an imu.yaml; the pose at the camera is that of EuRoC's
sensor.yaml, of a camchain with T_cam_imu, or of KITTI's calibrations. What none of them states is missing.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations.imu import body_from_imu, camera_from_imu, imu_noise
from ispom.io.files import exists, is_folder, names
from ispom.io.mapping import read_mapping
from ispom.io.sensor_tables import NMEA_SUFFIXES, read_measurements
from ispom.sensors import SENSOR_KINDS
from ispom.sensors.kind import FileOptions, Readings
from ispom.sequences.recorded_sensors import RecordedSensor, imu_origin
from ispom.sequences.sidecars import IMU_TABLES
from ispom.types import GnssAntenna, Imu, Kind

GNSS_TABLES = ("gnss.csv", "gps.csv", "gps.txt")
IMU_FILE, CHAIN_FILE = re.compile("(?<![a-z])imu"), re.compile("camchain|imucam")
"""What files of Kalibr and OpenVINS are called, such as dataset-imu.yaml and camchain-imucam-dataset.yaml."""
OXTS = "oxts"
EUROC_IMU = "imu0"
NO_POSE = "is not used, as its pose on the rig is not known"


def discovered_sensors(places: Sequence[Path]) -> tuple[RecordedSensor, ...]:
    """Returns the sensors whose files lie in folders; the first camera of a camchain there is that of the images."""
    found = list[RecordedSensor]()
    for place in filter(is_folder, places):
        for name in IMU_TABLES:
            if exists(place / name) and not is_folder(place / name):
                found.append(_imu_of(place / name, places))
        if is_folder(place / OXTS / "data"):
            found += oxts_sensors(place / OXTS, None, f"{NO_POSE} (no calibration of KITTI)")
        nmea = [name for name in names(place) if name.lower().endswith(NMEA_SUFFIXES)]
        for path in (place / name for name in (*GNSS_TABLES, *nmea)):
            if exists(path) and not is_folder(path):
                read = partial(readings_of_file, "gnss", path)
                found.append(RecordedSensor("gnss", str(path), GnssAntenna(), read, missing=NO_POSE, placed=False))
    return numbered(found)


def readings_of_file(kind: Kind, path: Path) -> Readings:
    """Returns what a sensor of a kind measured, by its file. Raises InputError that names what is wrong."""
    return SENSOR_KINDS.get(kind).readings(read_measurements(path), FileOptions(str(path)))


def numbered(found: Sequence[RecordedSensor]) -> tuple[RecordedSensor, ...]:
    """Returns sensors of one kind with names of their own: imu, imu_2 ..."""
    counts, out = dict[str, int](), list[RecordedSensor]()
    for each in found:
        counts[each.name] = counts.get(each.name, 0) + 1
        out.append(each if counts[each.name] == 1 else replace(each, name=f"{each.name}_{counts[each.name]}"))
    return tuple(out)


def _imu_of(table: Path, places: Sequence[Path]) -> RecordedSensor:
    try:
        noise, of_noise = imu_noise_beside(places)
        at = imu_pose_beside(places)
    except InputError as fault:
        missing = f"is not used: {fault.args[0]}"
        return RecordedSensor(
            "imu", str(table), Imu(), partial(readings_of_file, "imu", table), missing=missing, placed=False
        )
    if at is None:
        missing = f"{NO_POSE} (no camchain with T_cam_imu)"
        origin, read = imu_origin("", noise, of_noise), partial(readings_of_file, "imu", table)
        return RecordedSensor("imu", str(table), noise or Imu(), read, origin, missing, placed=False)
    pose, later_ns, of_pose = at
    sensor = replace(noise or Imu(), rig_from_sensor=pose)
    read = partial(_later, partial(readings_of_file, "imu", table), later_ns)
    return RecordedSensor("imu", str(table), sensor, read, imu_origin(of_pose, noise, of_noise))


def _later(read: Callable[[], Readings], by_ns: int) -> Readings:
    found = read()
    return replace(found, times_ns=found.times_ns + by_ns)


def imu_noise_beside(places: Sequence[Path]) -> tuple[Imu | None, str]:
    """Returns the noise of an IMU by a file of Kalibr, OpenVINS or TUM-VI in folders, and which it is; None without
    one. Raises InputError for an invalid one."""
    for path in _named(places, IMU_FILE, but=CHAIN_FILE):
        if (noise := imu_noise(path)) is not None:
            return noise, str(path)
    return None, ""


def imu_pose_beside(places: Sequence[Path], topic: str = "") -> tuple[Pose, int, str] | None:
    """Returns camera_from_imu by a camchain in folders, for the image `topic` or else its first camera; what is added
    to times of the IMU [ns]; and what they are from. None where there is none. Raises InputError for an invalid one."""
    for path in _named(places, CHAIN_FILE):
        if (found := camera_from_imu(path, topic)) is not None:
            pose, later_ns = found
            clock = f" (times of the IMU {later_ns * 1e-9:+.6f} s by its timeshift_cam_imu)" if later_ns else ""
            return pose, later_ns, f"{path}{clock}"
    return None


def _named(places: Sequence[Path], wanted: re.Pattern[str], but: re.Pattern[str] | None = None) -> list[Path]:
    """YAML files by a part of their names."""
    paths = [place / name for place in filter(is_folder, places) for name in names(place)]
    files = [path for path in paths if path.suffix.lower() in (".yaml", ".yml") and wanted.search(path.stem.lower())]
    return [path for path in files if but is None or not but.search(path.stem.lower())]


def euroc_imu(mav0: Path, left_from_raw: Pose, raw_from_body: Pose) -> tuple[RecordedSensor, ...]:
    """Returns the IMU of a `mav0`, whose raw left camera (cam0) is at a pose in the left camera of the recording.

    Its pose is that of imu0/sensor.yaml (T_BS), or of a camchain as TUM-VI has it; its noise that of the former, or of
    an imu.yaml or imu_config.yaml; these lie there, beside it, or in `dso`.
    """
    table, own = mav0 / EUROC_IMU / "data.csv", mav0 / EUROC_IMU / "sensor.yaml"
    if not exists(table):
        return ()
    parent = mav0.resolve().parent
    beside = (mav0, parent, parent / "dso")
    read = partial(readings_of_file, "imu", table)
    try:
        content = read_mapping(own) if exists(own) else {}
        noise, of_noise = imu_noise(own, content), str(own)
        if noise is None:
            noise, of_noise = imu_noise_beside(beside)
        in_body = body_from_imu(own, content)
        at = imu_pose_beside(beside) if in_body is None else (raw_from_body @ in_body, 0, str(own))
    except InputError as fault:
        return (RecordedSensor("imu", str(table), Imu(), read, missing=f"is not used: {fault.args[0]}", placed=False),)
    if at is None:
        origin = imu_origin("", noise, of_noise)
        missing = f"{NO_POSE} ({own} with T_BS is missing, and no camchain has T_cam_imu)"
        return (RecordedSensor("imu", str(table), noise or Imu(), read, origin, missing, placed=False),)
    pose, later_ns, of_pose = at
    sensor = replace(noise or Imu(), rig_from_sensor=left_from_raw @ pose)
    origin = imu_origin(of_pose, noise, of_noise)
    return (RecordedSensor("imu", str(table), sensor, partial(_later, read, later_ns), origin),)


def oxts_sensors(oxts: Path, left_from_unit: Pose | None, why: str = "") -> tuple[RecordedSensor, ...]:
    """Returns the IMU and the receiver of KITTI's GPS/IMU unit, whose positions are those of the unit itself.

    `why`: the reason where its pose is not known.
    """
    placed, pose = left_from_unit is not None, left_from_unit or Pose()
    at = "KITTI's calib_imu_to_velo.txt and calib_velo_to_cam.txt" if placed else ""
    missing = "" if placed else why
    fixes = "positions are smoothed by the unit, and their errors last; their standard deviations are its pos_accuracy"
    imu = Imu(rig_from_sensor=pose)
    antenna = GnssAntenna(rig_from_sensor=pose)
    origin = [imu_origin(at, None, ""), f"pose of {at}, {fixes}" if placed else fixes]
    return (
        RecordedSensor("imu", f"{oxts} (IMU)", imu, partial(readings_of_file, "imu", oxts), origin[0], missing, placed),
        RecordedSensor(
            "gnss", f"{oxts} (GNSS)", antenna, partial(readings_of_file, "gnss", oxts), origin[1], missing, placed
        ),
    )
