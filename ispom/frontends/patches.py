"""Patches found again with sub-pixel accuracy, from the image that saw them first: no drift from frame to frame.

Inverse compositional alignment (Baker & Matthews 2004) of a place and an offset of the brightness; the patch is
warped beforehand as the scene's geometry says, as in Forster et al. 2014, section IV-B.
"""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array
from ispom.kernels import kernel, part
from ispom.types import Camera, Image

RADIUS_PX = 5
"""Half the side of a patch: 11 x 11 pixels."""


def align(
    reference: Image, reference_uv: Array, image: Image, uv: Array, warps: Array, iterations: int = 8
) -> tuple[Array, Array]:
    """Places (N, 2) [px] in `image` of the patches of `reference` at (N, 2), looked for from `uv` (N, 2) on.

    `warps` (N, 2, 2): reference pixels per image pixel around each point. Also gives the correlation (N,) of patch and
    image there, -1..1; -1 where a patch reaches out of an image or has no texture.
    """
    return _align(
        reference,
        np.ascontiguousarray(reference_uv, np.float64),
        image,
        np.array(uv, np.float64),
        np.ascontiguousarray(warps),
        iterations,
    )


def warps_of(camera: Camera, rotations: Array, translations: Array, xyz_in_camera: Array) -> Array:
    """(N, 2, 2) reference pixels per image pixel at points (N, 3), on surfaces that face the camera (no distortion).

    `rotations` (N, 3, 3) and `translations` (N, 3): reference_from_camera, of each point or (1, ...) of all.
    """
    r, ratio = rotations, camera.fx / camera.fy
    p = (r @ xyz_in_camera[:, :, None])[..., 0] + translations
    iz = 1 / np.maximum(p[:, 2], 1e-6)
    u, v, z = p[:, 0] * iz, p[:, 1] * iz, xyz_in_camera[:, 2]
    out = np.empty((len(p), 2, 2))
    out[:, 0, 0], out[:, 0, 1] = r[:, 0, 0] - u * r[:, 2, 0], (r[:, 0, 1] - u * r[:, 2, 1]) * ratio
    out[:, 1, 0], out[:, 1, 1] = (r[:, 1, 0] - v * r[:, 2, 0]) / ratio, r[:, 1, 1] - v * r[:, 2, 1]
    return out * (z * iz)[:, None, None]


@part
def _at(image, u, v):
    x, y = int(u), int(v)
    a, b = u - x, v - y
    return (1 - b) * ((1 - a) * image[y, x] + a * image[y, x + 1]) + b * (
        (1 - a) * image[y + 1, x] + a * image[y + 1, x + 1]
    )


@part
def _sample(image, u, v, out):
    """The patch of an image around a place within it, row after row."""
    x, y, side = int(u) - RADIUS_PX, int(v) - RADIUS_PX, 2 * RADIUS_PX + 1
    a, b = u - int(u), v - int(v)
    w00, w01, w10, w11 = (1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b
    for i in range(side):
        upper, lower = image[y + i, x : x + side + 1], image[y + i + 1, x : x + side + 1]
        for j in range(side):
            out[i * side + j] = w00 * upper[j] + w01 * upper[j + 1] + w10 * lower[j] + w11 * lower[j + 1]


@kernel(fastmath={"contract", "reassoc"})
def _align(reference, reference_uv, image, uv, warps, iterations):
    n, side = len(uv), 2 * RADIUS_PX + 1
    score = np.full(n, -1.0)
    wide, patch = np.empty((side + 2, side + 2)), np.empty((side, side))
    gx, gy = np.empty((side, side)), np.empty((side, side))
    area = side * side
    now, flat, flat_x, flat_y = np.empty(area), patch.reshape(area), gx.reshape(area), gy.reshape(area)
    for k in range(n):
        # The patch with a border, for its gradient.
        inside = True
        reach = RADIUS_PX + 1
        for cy in (-reach, reach):
            for cx in (-reach, reach):
                u = reference_uv[k, 0] + warps[k, 0, 0] * cx + warps[k, 0, 1] * cy
                v = reference_uv[k, 1] + warps[k, 1, 0] * cx + warps[k, 1, 1] * cy
                if not (0 <= u < reference.shape[1] - 1 and 0 <= v < reference.shape[0] - 1):
                    inside = False
        if not inside:
            continue
        for i in range(side + 2):
            for j in range(side + 2):
                cx, cy = j - reach, i - reach
                wide[i, j] = _at(
                    reference,
                    reference_uv[k, 0] + warps[k, 0, 0] * cx + warps[k, 0, 1] * cy,
                    reference_uv[k, 1] + warps[k, 1, 0] * cx + warps[k, 1, 1] * cy,
                )
        mean, mx, my = 0.0, 0.0, 0.0
        for i in range(side):
            for j in range(side):
                patch[i, j] = wide[i + 1, j + 1]
                gx[i, j] = 0.5 * (wide[i + 1, j + 2] - wide[i + 1, j])
                gy[i, j] = 0.5 * (wide[i + 2, j + 1] - wide[i, j + 1])
                mean += patch[i, j]
                mx += gx[i, j]
                my += gy[i, j]
        mean, mx, my = mean / area, mx / area, my / area
        # Without its mean everything is free of the brightness offset.
        hxx, hxy, hyy, power = 0.0, 0.0, 0.0, 0.0
        for i in range(side):
            for j in range(side):
                patch[i, j] -= mean
                gx[i, j] -= mx
                gy[i, j] -= my
                hxx += gx[i, j] * gx[i, j]
                hxy += gx[i, j] * gy[i, j]
                hyy += gy[i, j] * gy[i, j]
                power += patch[i, j] * patch[i, j]
        det = hxx * hyy - hxy * hxy
        if det < 1e-3 * (hxx + hyy) * (hxx + hyy) or power < area:
            continue
        u, v = uv[k, 0], uv[k, 1]
        for _ in range(iterations + 1):
            if not (
                RADIUS_PX <= u < image.shape[1] - RADIUS_PX - 1 and RADIUS_PX <= v < image.shape[0] - RADIUS_PX - 1
            ):
                score[k] = -1.0
                break
            _sample(image, u, v, now)
            bx, by, total, squares, product = 0.0, 0.0, 0.0, 0.0, 0.0
            for i in range(area):
                total += now[i]
                squares += now[i] * now[i]
                product += now[i] * flat[i]
                difference = now[i] - flat[i]
                bx += flat_x[i] * difference
                by += flat_y[i] * difference
            variance = squares - total * total / area
            score[k] = product / np.sqrt(power * variance) if variance > 1e-6 else -1.0
            du, dv = (hyy * bx - hxy * by) / det, (hxx * by - hxy * bx) / det
            if du * du + dv * dv < 1e-6:
                break
            u, v = u - du, v - dv
        uv[k, 0], uv[k, 1] = u, v
    return uv, score
