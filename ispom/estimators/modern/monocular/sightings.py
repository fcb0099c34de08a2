"""Where the key frames saw what descriptors found: by patches, in all of them that are adjusted together.

A descriptor's place is off by a pixel, and the two or three key frames that were compared lie close together, before a
turn above all: what was seen again by them alone held the pose after a gap less well than tracks do.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.estimators.modern.lens import Lens
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.place_patches import patches_found
from ispom.estimators.modern.monocular.recognise import Recognised, rays_met
from ispom.estimators.modern.monocular.setup import INLIER, Setup
from ispom.estimators.modern.monocular.tracks import nearest_speed
from ispom.estimators.modern.places import Place, Places, in_sight
from ispom.estimators.modern.rolling import late_px
from ispom.geometry import Array

MIN_SIGNIFICANCE = 1.5
"""An inverse depth exceeds this many standard deviations of it: far points still show the camera's rotation."""


def resighted(setup: Setup, kept: Places, world: Map, found: Recognised) -> Recognised:
    """What was found with its points (N, 3) intersected from where patches are, also in the window's other key frames.

    Where patches do not agree with one still point, or no other key frame has them, it stays as descriptors say.
    """
    place, at = found.views[-1]
    others, window = {p.time_ns: (p, uv) for p, uv in found.views[:-1]}, {k.time_ns for k in world.keys}
    if window & {*others, place.time_ns}:
        nowhere = np.full_like(at, np.nan)
        others = {p.time_ns: (p, nowhere) for p in kept.kept if p.time_ns in window - {place.time_ns}} | others
    views = [others[time_ns] for time_ns in sorted(others)]
    patches = [_sighted(setup, world.extra, place, at, found.xyz, p) for p, _ in views]
    met = rays_met(setup, world.extra, [*(p for p, _ in views), place], [*patches, at], setup.noise)
    agree = (met.depth > 0) & (met.worst < INLIER * setup.noise.width) & (met.significance > MIN_SIGNIFICANCE)
    agree &= np.isfinite(np.stack(patches)[:, :, 0]).any(axis=0)
    seen = [(p, np.where(agree[:, None], uv, old)) for (p, old), uv in zip(views, patches, strict=True)]
    return replace(found, views=(*seen, (place, at)), xyz=np.where(agree[:, None], met.xyz_in_world, found.xyz))


def _sighted(setup: Setup, extra: Array, place: Place, at: Array, xyz: Array, other: Place) -> Array:
    """(N, 2) [px] where another place has the patches that a place has `at` (N, 2) [px], of points (N, 3); else NaN."""
    lens, near = Lens(setup.camera, extra), other.camera_from_world.apply(xyz)
    expected = in_sight(setup.camera, near, lens.project(near))
    some = np.flatnonzero(np.isfinite(expected[:, 0]) & np.isfinite(at[:, 0]))
    expected, uv = expected[some], np.full_like(at, np.nan)
    if other.moving is not None:
        middle = expected.astype(np.float32)
        expected = expected + late_px(setup.camera, middle, nearest_speed(*other.moving, middle))
    back = place.camera_from_world @ other.camera_from_world.inverse()
    found, good = patches_found(lens, place, at[some], back, near[some], other.images[0], expected, other.reduction)
    uv[some[good]] = found[good]
    return uv
