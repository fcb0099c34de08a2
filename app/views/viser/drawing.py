"""Converts numbers and images to SVG and HTML."""

from __future__ import annotations

from base64 import b64encode

import numpy as np

from ispom.geometry import Array
from ispom.types import Image

from ...engine.run_folder.thumbnail import jpeg

JPEG_QUALITY = 75


def dots(uv: Array) -> str:
    """A path of points (N, 2) in pixels: lines without length, which round caps make visible."""
    return "".join(f"M{u:.1f} {v:.1f}h0" for u, v in in_view(uv).tolist())


def polyline(uv: Array) -> str:
    """The points (N, 2) of a polyline in pixels."""
    return " ".join(f"{u:.1f},{v:.1f}" for u, v in in_view(uv).tolist())


def in_view(uv: Array) -> Array:
    """(K, 2) in the coordinates of an SVG, which count from the corner of the first pixel; without unknown ones."""
    uv = np.asarray(uv, float).reshape(-1, 2)
    return uv[np.isfinite(uv).all(1)] + 0.5


def picture(image: Image, width: int) -> str:
    """Returns a data URL with the image as JPEG, at most `width` pixels wide."""
    return f"data:image/jpeg;base64,{b64encode(jpeg(image, JPEG_QUALITY, width)).decode()}"
