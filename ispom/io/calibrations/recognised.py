"""A calibration in any of the known formats, recognised by what the file holds."""

from __future__ import annotations

from pathlib import Path

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations.colmap_cameras import read_colmap_cameras
from ispom.io.calibrations.euroc_sensor import read_euroc_sensor
from ispom.io.calibrations.files import placed_of
from ispom.io.calibrations.kalibr import read_kalibr
from ispom.io.calibrations.opencv import read_opencv
from ispom.io.calibrations.placed import Placed
from ispom.io.calibrations.ros import read_ros
from ispom.io.camera import INTRINSICS, SIZES, read_camera
from ispom.io.files import exists, is_folder, names
from ispom.io.mapping import MAX_BYTES, read_mapping
from ispom.io.rig import ENTRIES, read_rig
from ispom.io.rows import read_text
from ispom.types import Camera, Rig

KNOWN = (
    "rig.yaml, camera.yaml, Kalibr's camchain, EuRoC's sensor.yaml, OpenCV's YAML, ROS's camera_info, or COLMAP's "
    "cameras.txt"
)
_ALIASES = {"cam0": "left", "cam1": "right", "cam2": "video", "mono": "video"}
_ORDER = {1: ("video",), 2: ("left", "right"), 3: ("left", "right", "video")}


def any_camera(path: Path) -> Camera:
    """The one camera of a file; InputError where it holds several, or none."""
    cameras, _ = _read(path)
    if len(cameras) != 1:
        raise InputError(f"{path} holds {len(cameras)} cameras: give the file of one camera")
    return cameras[0].camera


def any_rig(paths: tuple[Path, ...]) -> Rig:
    """The rig of one file, or of files of one camera each; a folder holds such files, or folders with sensor.yaml.

    Cameras are called by the names in the files, else left, right and video in this order; one alone is video.
    InputError where a file is of no known format, or several cameras have no poses.
    """
    files = tuple(file for path in paths for file in _files(path))
    found, posed = [], True
    for file in files:
        cameras, has_poses = _read(file)
        found += cameras
        posed &= has_poses
    if len(found) > 1 and not posed:
        raise InputError(
            f"{paths[0]} holds {len(found)} cameras without their poses: give a format with poses, such as "
            "Kalibr's, or one camera"
        )
    fields: dict[str, object] = {}
    for name, each in zip(_names(paths[0], found), found, strict=True):
        fields |= {name: each.camera, f"rig_from_{name}": each.body_from_camera}
    rig = Rig(**fields)  # type: ignore[arg-type]
    for own in (read_rig(file) for file in files if _is_rig(file)):
        rig = own.beside(rig)
    return rig


def _names(path: Path, found: list[Placed]) -> tuple[str, ...]:
    own = [_ALIASES.get(each.name.lower(), each.name.lower()) for each in found]
    if len(own) > 1 and len(set(own)) == len(own) and set(own) <= {"left", "right", "video"}:
        return tuple(own)
    if len(found) not in _ORDER:
        raise InputError(f"{path} holds {len(found)} cameras: give one, a pair, or a pair and a video camera")
    return _ORDER[len(found)]


def _files(path: Path) -> tuple[Path, ...]:
    if not is_folder(path):
        return (path,)
    inside = [path / name for name in names(path)]
    sensors = [each / "sensor.yaml" for each in inside if is_folder(each) and exists(each / "sensor.yaml")]
    sensors = [sensor for sensor in sensors if _is_of_camera(sensor)]
    files = sensors or [each for each in inside if each.suffix.lower() in (".yaml", ".yml")]
    if not files:
        raise InputError(f"{path} holds no calibration: give a file such as {KNOWN}")
    return tuple(files)


def _is_of_camera(path: Path) -> bool:
    """EuRoC's IMU has a sensor.yaml, too."""
    return "intrinsics" in read_mapping(path)


def _read(path: Path) -> tuple[list[Placed], bool]:
    """The cameras of one file, and whether it says where they sit."""
    text = read_text(path, MAX_BYTES)
    if path.suffix.lower() == ".txt":
        return _unplaced(path, read_colmap_cameras(path)), False
    if "opencv-matrix" in text:
        return read_opencv(path), True
    if _is_rig(path):
        return placed_of(read_rig(path)), True
    keys = {key for key in read_mapping(path) if isinstance(key, str)}
    if any(key.startswith("cam") and key[3:].isdigit() for key in keys):
        return read_kalibr(path), True
    if "T_BS" in keys:
        return [read_euroc_sensor(path)], True
    if "camera_matrix" in keys:
        return _unplaced(path, [read_ros(path)]), False
    if keys & {"model", *SIZES, *INTRINSICS}:
        return _unplaced(path, [read_camera(path)]), False
    raise InputError(f"{path} is no calibration that is known: give {KNOWN}")


def _is_rig(path: Path) -> bool:
    """Whether it is a rig.yaml."""
    if path.suffix.lower() == ".txt" or "opencv-matrix" in read_text(path, MAX_BYTES):
        return False
    keys = {key for key in read_mapping(path) if isinstance(key, str)}
    return bool(keys) and keys <= ENTRIES


def _unplaced(path: Path, cameras: list[Camera]) -> list[Placed]:
    return [Placed(path.stem, camera, Pose()) for camera in cameras]
