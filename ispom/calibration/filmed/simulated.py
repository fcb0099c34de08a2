"""`sim:calibration` as images to calibrate from, and how far a result is from its truth."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from urllib.parse import parse_qsl

import numpy as np

from ispom.calibration.adjust.lens import model_of, parameter_names, vector_of
from ispom.calibration.filmed.images import CAMERAS, Source
from ispom.calibration.result import Calibration
from ispom.calibration.targets.drawing import MARGIN_M, raster
from ispom.calibration.targets.target import Target
from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.settings import check
from ispom.simulation.filmed_board import FilmedBoard, How, Picture
from ispom.types import FrameName, Rig

NAME = "sim:calibration"
LONGER_SIDE_PX = 1800
"""Of the target's picture."""


@dataclass(frozen=True, eq=False)
class Simulated:
    sources: tuple[Source, ...]
    truth: Rig


def is_simulated(paths: tuple[Path, ...]) -> bool:
    """Returns whether a simulation is asked for, not images."""
    return len(paths) == 1 and str(paths[0]).startswith("sim:")


def simulated(what: str, source: Path, target: Target) -> Simulated:
    """Returns the images of `sim:calibration?views=30&alike&blur_ms=20`. Raises InputError for another name or
    setting."""
    name, _, settings = str(source).partition("?")
    if name != NAME:
        raise InputError(f"{name} is no simulated calibration: give {NAME}, or {NAME}?views=30&seed=1&alike&blur_ms=20")
    how = _how(settings)
    pixels_per_m = LONGER_SIDE_PX / (max(target.size_m) + 2 * MARGIN_M)
    picture = Picture(raster(target, pixels_per_m), pixels_per_m, MARGIN_M)
    film = FilmedBoard.of(picture, target.size_m, "video" if what == "video" else "left", how)
    return Simulated(tuple(_source(film, camera) for camera in CAMERAS[what]), film.rig)


def _source(film: FilmedBoard, camera: str) -> Source:
    name: FrameName = camera  # type: ignore[assignment]
    names = tuple(f"{i:03d}" for i in range(film.how.views))
    return Source(camera, Path(NAME), names, None, lambda i: film.image(name, int(i)))


def _how(settings: str) -> How:
    """InputError for what is no setting, or out of its range."""
    kinds, found = {f.name: type(getattr(How(), f.name)) for f in fields(How)}, How()
    for name, value in parse_qsl(settings, keep_blank_values=True):
        try:
            switched = kinds[name] is bool and not value
            found = replace(found, **{name: True if switched else kinds[name](float(value))})
        except (KeyError, ValueError, OverflowError):
            raise InputError(f"{NAME} has no {name[:40]}={value[:40]}: use {', '.join(kinds)}") from None
    check(found, f"{NAME} ")
    return found


def truth_words(found: Calibration, truth: Rig) -> list[str]:
    """Returns how far each parameter is from the truth, also in its own standard errors, and the poses of the
    cameras."""
    lines = []
    for each in found.cameras:
        camera = truth.camera(each.views.name)  # type: ignore[arg-type]
        true = dict(zip(parameter_names(model_of(camera)), vector_of(camera).tolist(), strict=True))
        deviations = []
        for parameter in found.parameters:
            if parameter.camera == each.views.name and parameter.name in true and parameter.standard_error > 0:
                off = parameter.value - true[parameter.name]
                deviations.append(f"{parameter.name} {off:+.3g} ({abs(off) / parameter.standard_error:.1f} sigma)")
        lines.append(f"{each.views.name} minus its truth: {', '.join(deviations)}")
    first = found.cameras[0].views.name
    for each in found.cameras[1:]:
        ways = [_between(rig, first, each.views.name) for rig in (found.rig, truth)]
        difference = ways[0] @ ways[1].inverse()
        turn, shift = np.degrees(np.linalg.norm(difference.rotvec)), ways[0].translation - ways[1].translation
        lines.append(
            f"{each.views.name} on the rig: {turn:.4f} deg and {1000 * np.linalg.norm(shift):.2f} mm from its truth"
        )
    return lines


def _between(rig: Rig, one: str, other: str) -> Pose:
    """other_from_one."""
    return rig.rig_from(other).inverse() @ rig.rig_from(one)  # type: ignore[arg-type]
