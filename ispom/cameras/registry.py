"""The registry of camera models: the built-in ones, and those of installed packages (entry points `ispom.cameras`)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ispom.cameras.model import CameraModel
from ispom.cameras.opencv import FISHEYE, PINHOLE, RADIAL_TANGENTIAL, RATIONAL
from ispom.errors import InputError
from ispom.registry import Registry

if TYPE_CHECKING:
    from ispom.cameras.camera import Camera

BUILT_IN = (PINHOLE, RADIAL_TANGENTIAL, RATIONAL, FISHEYE)
CAMERA_MODELS: Registry[CameraModel] = Registry(
    "ispom.cameras",
    CameraModel,  # type: ignore[type-abstract]
    "camera model",
    BUILT_IN,
    "or install the package that adds it",
)
OPENCV = "opencv"
"""Common name of the perspective models; the number of coefficients selects one of them."""


def model_of(lens: str, count: int) -> CameraModel:
    """Returns the model of a lens with `count` coefficients. Raises InputError where no installed package has it."""
    if lens == OPENCV:
        return PINHOLE if not count else RADIAL_TANGENTIAL if count <= 5 else RATIONAL
    return FISHEYE if lens == FISHEYE.name else CAMERA_MODELS.get(lens)


def require_opencv(camera: Camera, what: str) -> None:
    """Raises InputError where the camera's model is not one of OpenCV's, the only ones that `what` supports."""
    if camera.lens not in (OPENCV, FISHEYE.name):
        raise InputError(
            f"{what} has no camera model {camera.lens}: use a camera of the models opencv or fisheye there"
        )
