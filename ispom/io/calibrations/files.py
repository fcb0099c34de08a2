"""Writes a rig as files of another program."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import yaml

from ispom.errors import InputError
from ispom.io.calibrations.camera_info import ros_texts
from ispom.io.calibrations.kalibr import euroc_sensor_text, kalibr_text
from ispom.io.calibrations.opencv import opencv_text
from ispom.io.calibrations.placed import FlowDumper, Placed
from ispom.io.camera import INTRINSICS, LINE_DELAY, SIZES, line_delay_entry
from ispom.io.colmap import colmap_cameras_text
from ispom.io.rig import SIGMAS
from ispom.types import Camera, Rig

Format = Literal["camera", "kalibr", "euroc", "opencv", "ros", "colmap"]
AnyFormat = Literal["rig", "camera", "kalibr", "euroc", "opencv", "ros", "colmap"]
"""Including ISPOM's own rig.yaml."""
_ORDER = ("left", "right", "video")


def placed_of(rig: Rig) -> list[Placed]:
    """Returns the cameras of a rig: left, right, video."""
    return [
        Placed(name, rig.camera(name), rig.rig_from(name))  # type: ignore[arg-type]
        for name in _ORDER
        if getattr(rig, name) is not None
    ]


def camera_text(camera: Camera) -> str:
    """Returns a camera.yaml."""
    values: dict[str, object] = {"model": camera.lens} if camera.lens != "opencv" else {}
    values |= {key: getattr(camera, key) for key in SIZES}
    values |= {key: float(getattr(camera, key)) for key in INTRINSICS}
    values |= {"distortion": list(map(float, camera.distortion)), **line_delay_entry(camera)}
    return yaml.dump(values, Dumper=FlowDumper, sort_keys=False)


def rig_files(rig: Rig, form: Format) -> dict[str, str]:
    """Returns contents by file name: one file, or one for each camera where the format requires it."""
    cameras = placed_of(rig)
    if form == "camera":
        if len(cameras) > 1:
            raise InputError("--format camera is of one camera: choose rig for several")
        return {"camera.yaml": camera_text(cameras[0].camera)}
    if form == "kalibr":
        imu = next((each for each in rig.sensors.values() if each.kind == "imu"), None)
        return {"camchain.yaml": kalibr_text(cameras, None if imu is None else imu.rig_from_sensor)}
    if form == "opencv":
        return {"calibration.yml": opencv_text(cameras)}
    if form == "colmap":
        return {"cameras.txt": colmap_cameras_text(cameras)}
    if form == "euroc":
        return {f"{each.name}/sensor.yaml": euroc_sensor_text(each) for each in cameras}
    return {f"{name}.yaml": text for name, text in ros_texts(cameras).items()}


def left_out(rig: Rig, form: AnyFormat) -> Iterator[str]:
    """Yields a sentence about each entry of a rig that the format cannot hold: line delays of rolling shutters, poses,
    and standard deviations of the calibration."""
    rolling = [each.name for each in placed_of(rig) if each.camera.line_delay_s]
    if rolling and form not in ("rig", "camera"):
        which = f"{LINE_DELAY} of {' and '.join(rolling)}"
        yield f"--format {form} has no place for a rolling shutter: {which} is left out; rig.yaml keeps it"
    unplaced = _poses_lost(rig, form)
    if unplaced:
        yield f"--format {form} has no poses of {' and '.join(unplaced)}: left out; rig.yaml keeps them"
    sigmas = [name for name in SIGMAS if getattr(rig, name) is not None]
    if sigmas and form != "rig":
        what = "how sure the calibration is"
        yield f"--format {form} has no place for {what}: left out: {' and '.join(sigmas)}; rig.yaml keeps it"


def _poses_lost(rig: Rig, form: AnyFormat) -> list[str]:
    """Returns the cameras whose poses a format cannot hold. COLMAP's has none, ROS's has those of a pair."""
    cameras = [each.name for each in placed_of(rig)]
    if len(cameras) < 2 or form not in ("colmap", "ros"):
        return []
    return [name for name in cameras if form == "colmap" or not rig.has_stereo or name == "video"]
