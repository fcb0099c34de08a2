"""Camera models as vectors of parameters."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from ispom.geometry import Array
from ispom.types import Camera

Model = Literal["pinhole", "radtan", "rational", "fisheye"]
MODELS: tuple[Model, ...] = ("pinhole", "radtan", "fisheye", "rational")
"""In order of complexity: no distortion; k1 k2 p1 p2; Kannala and Brandt's k1 to k4; k1 k2 p1 p2 k3 k4 k5 k6."""
_DISTORTION: dict[Model, tuple[str, ...]] = {
    "pinhole": (),
    "radtan": ("k1", "k2", "p1", "p2"),
    "rational": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "fisheye": ("k1", "k2", "k3", "k4"),
}
FOCAL_AND_CENTRE = ("fx", "fy", "cx", "cy")


def parameter_names(model: Model) -> tuple[str, ...]:
    """Returns the names of the elements of a camera's vector."""
    return (*FOCAL_AND_CENTRE, *_DISTORTION[model])


def model_of(camera: Camera) -> Model:
    """Returns the least model that has the camera's coefficients."""
    if camera.lens == "fisheye":
        return "fisheye"
    return {0: "pinhole", 4: "radtan"}.get(len(camera.distortion), "rational")  # type: ignore[return-value]


def as_model(camera: Camera, model: Model) -> Camera:
    """Returns the camera with the coefficients of the model; further ones are dropped.

    Between a fisheye lens and the others only focal lengths and centre are kept.
    """
    lens = "fisheye" if model == "fisheye" else "opencv"
    old = camera.distortion if camera.lens == lens else ()
    count = len(_DISTORTION[model])
    return replace(camera, distortion=(*old, *(0.0,) * count)[:count], lens=lens)


def vector_of(camera: Camera) -> Array:
    """(P,) fx, fy, cx, cy and the coefficients."""
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion])


def with_vector(camera: Camera, vector: Array) -> Camera:
    """Returns the camera of this vector, as `vector_of` has it."""
    values = [float(v) for v in vector]
    return replace(camera, fx=values[0], fy=values[1], cx=values[2], cy=values[3], distortion=tuple(values[4:]))
