"""Patches that a key frame saw, found in another image: descriptors' places are off by a pixel, those of patches by as
much as those of tracks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.lens import Lens
from ispom.estimators.modern.monocular.realign import TAPER_PX
from ispom.estimators.modern.monocular.surfaces import slopes
from ispom.estimators.modern.places import Place
from ispom.features.patches import align, warps_of
from ispom.geometry import Array, Pose
from ispom.types import Image

MIN_CORRELATION, MAX_SHIFT_PX = 0.8, 3.0
"""As for tracks: a patch that correlates less with that of the key frame, or is farther off, is another thing."""


def patches_found(
    lens: Lens,
    place: Place,
    seen: Array,
    place_from_camera: Pose,
    near: Array,
    image: Image,
    expected: Array,
    reduction: float = 1.0,
) -> tuple[Array, NDArray[np.bool_]]:
    """Where an image has the patches that a place has at `seen` (N, 2) [px], looked for around `expected` (N, 2) [px];
    and which (N,) it has. `near` (N, 3): their points in the image's camera; `reduction`: its pixels per the camera's.
    """
    turn, way = place_from_camera.rotation[None], place_from_camera.translation[None]
    warps, bends = warps_of(lens.camera, turn, way, near, slopes(near))
    warps, bends = place.reduction / reduction * warps, bends / reduction
    start = (expected + 0.5) * reduction - 0.5
    found, score = align(place.images[0], place.reduced(seen), image, start, warps, bends=bends, taper_px=TAPER_PX)
    found = (found + 0.5) / reduction - 0.5
    return found, (score > MIN_CORRELATION) & (np.linalg.norm(found - expected, axis=1) < MAX_SHIFT_PX)
