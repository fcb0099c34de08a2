"""Whether the values of a camera can be those of a lens in front of a sensor."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array
from ispom.plausibility.doubt import Doubt
from ispom.types import Camera

USUAL_CENTRE = 0.25
"""The principal point is rarely farther from the image's centre than this share of its side,"""
USUAL_ASPECT = 1.2
"""Largest ratio of the two focal lengths,"""
SHORTEST, LONGEST = 0.12, 4.0
"""and focal lengths of lenses that are no fisheye are rarely shorter or longer than these shares of the longer side:
views of 153 and of 14 degrees. Lenses of 24 to 70 mm have 0.67 to 1.9."""
OFF_CENTRE, BACK = 0.06, 0.4
"""cx and cy are exchanged where they lie by this share of the longer side beside the middle, and, exchanged, by so much
less of that. Lenses are mounted to 0.03."""
BENT = 0.5
"""Largest displacement by the distortion at the middle of the image's border, as a share of the distance from the
centre; wide-angle lenses described by polynomials have up to 0.35."""
BORDER, FOLDED, UNDONE_PX = 17, 0.1, 1.0
"""Grid of pixels, the share of them whose distortion cannot be undone (polynomials often fold in the corners), and how
near distorting again must lead."""


def camera_doubts(camera: Camera, where: str) -> tuple[Doubt, ...]:
    """Returns doubts about a camera, which begin with `where`."""
    return (*_of_centre(camera, where), *_of_focal_lengths(camera, where), *_of_distortion(camera, where))


def _of_centre(camera: Camera, where: str) -> tuple[Doubt, ...]:
    centre, middle = np.array([camera.cx, camera.cy]), np.array([camera.width - 1, camera.height - 1]) / 2
    off = np.abs(centre - middle).max() / camera.longer_side_px
    exchanged = np.abs(centre[::-1] - middle).max() / camera.longer_side_px
    if off > OFF_CENTRE and exchanged < BACK * off:
        text = (
            f"{where}: cx is {camera.cx:g} and cy {camera.cy:g} px, in an image of {camera.width} x {camera.height} px"
        )
        return (Doubt("centre_swapped", f"{text}: they look exchanged."),)
    sides = ("cx", camera.cx, camera.width), ("cy", camera.cy, camera.height)
    return tuple(
        Doubt("centre_far", f"{where}: {key} is {value:g} px, far from the middle of {side} px: check it")
        for key, value, side in sides
        if abs(value - (side - 1) / 2) > USUAL_CENTRE * side
    )


def _of_focal_lengths(camera: Camera, where: str) -> tuple[Doubt, ...]:
    out, longer = [], camera.longer_side_px
    if not 1 / USUAL_ASPECT <= camera.fx / camera.fy <= USUAL_ASPECT:
        text = f"{where}: fx is {camera.fx:g} px and fy {camera.fy:g} px, as of pixels that are not square: check it"
        out.append(Doubt("focal_aspect", text))
    if camera.lens == "opencv" and min(camera.fx, camera.fy) < SHORTEST * longer:
        text = f"{where}: fx is {camera.fx:g} px, very short for a lens that is no fisheye: is it in millimetres?"
        out.append(Doubt("focal_short", text))
    if min(camera.fx, camera.fy) > LONGEST * longer:
        view = np.degrees(2 * np.arctan(longer / (2 * min(camera.fx, camera.fy))))
        text = f"{where}: fx is {camera.fx:g} px, a view of {view:.2g} degrees: this looks like a focal length that is "
        out.append(Doubt("focal_long", f"{text}too long, unless the lens is a telephoto lens; check it."))
    return tuple(out)


def _of_distortion(camera: Camera, where: str) -> tuple[Doubt, ...]:
    if not any(camera.distortion):
        return ()
    if camera.lens == "opencv" and (bent := _bent(camera)) > BENT:
        shown = ", ".join(f"{value:g}" for value in camera.distortion)
        text = f"{where}: the distortion {shown} moves the border of the image by {bent:.0%} of its distance from the "
        return (Doubt("distortion_large", f"{text}middle: this looks like a wrong coefficient, or another order."),)
    lost = lost_share(camera)
    if lost <= FOLDED:
        return ()
    text = f"{where}: the distortion cannot be undone in {lost:.0%} of the image, where it folds back"
    return (Doubt("distortion_folds", f"{text}: calibrate with corners up to the image's border."),)


def _bent(camera: Camera) -> float:
    """The largest displacement at the middles of the four borders, relative to the distance from the centre."""
    x = (np.array([0, camera.width - 1]) - camera.cx) / camera.fx
    y = (np.array([0, camera.height - 1]) - camera.cy) / camera.fy
    rays = np.array([[x[0], 0, 1], [x[1], 0, 1], [0, y[0], 1], [0, y[1], 1]])
    with np.errstate(all="ignore"):
        uv = camera.project(rays)
    centre, scale = np.array([camera.cx, camera.cy]), np.array([camera.fx, camera.fy])
    straight: Array = rays[:, :2] * scale
    lengths = np.linalg.norm(straight, axis=1)
    moved = np.linalg.norm(uv - centre - straight, axis=1) / np.maximum(lengths, 1.0)
    return float(np.nan_to_num(moved, nan=np.inf).max())


def lost_share(camera: Camera) -> float:
    """Returns the share of the image's pixels whose distortion cannot be undone."""
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, BORDER), np.linspace(0, camera.height - 1, BORDER))
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    with np.errstate(all="ignore"):
        rays = np.column_stack([camera.normalise(uv), np.ones(len(uv))])
        away_px = np.linalg.norm(camera.project(rays) - uv, axis=1)
    return float(1 - (away_px <= UNDONE_PX).mean())
