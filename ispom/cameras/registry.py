"""The table of camera models: the built-in ones, and those of installed packages (entry points `ispom.cameras`)."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from ispom.cameras.model import CameraModel
from ispom.errors import InputError
from ispom.plugins import Table

if TYPE_CHECKING:
    from ispom.cameras.camera import Camera

GROUP = "ispom.cameras"
OPENCV = "opencv"
"""The perspective models together: the number of coefficients names one of them."""


@cache
def camera_models() -> Table[CameraModel]:
    """Returns the table of all camera models by name."""
    from ispom.cameras.opencv import FISHEYE, PINHOLE, RADIAL_TANGENTIAL, RATIONAL  # they need Camera, which needs this

    built_in = (PINHOLE, RADIAL_TANGENTIAL, RATIONAL, FISHEYE)
    return Table(GROUP, CameraModel, ((model.name, model) for model in built_in))  # type: ignore[type-abstract]


@cache
def model_of(lens: str, count: int) -> CameraModel:
    """Returns the model of a lens with `count` coefficients. Raises InputError where no installed package has it."""
    models = camera_models().entries
    if lens == OPENCV:
        return models["pinhole" if not count else "radtan" if count <= 5 else "rational"]
    if lens not in models:
        raise InputError(f"camera model {lens[:60]!r} is not known: choose from {', '.join((OPENCV, *models))}")
    return models[lens]


def require_opencv(camera: Camera, what: str) -> None:
    """Raises InputError where the camera's model is not one of OpenCV's, which is all that `what` knows."""
    if camera.lens not in (OPENCV, "fisheye"):
        raise InputError(
            f"{what} has no camera model {camera.lens}: use a camera of the models opencv or fisheye there"
        )
