"""Targets on paper: SVG and PDF of true size, and pictures of them for the simulation."""

from __future__ import annotations

import cv2
import numpy as np

from ispom.calibration.targets.target import Disc, Target
from ispom.geometry import Array
from ispom.types import Image

MARGIN_M = 0.02
"""White around the pattern."""
POINTS_PER_M = 72 / 0.0254
_KAPPA = 0.5522847498
"""Length of the handles of the four Bezier curves that make a circle, of its radius."""
_SHIFT = 10
"""Binary digits behind the point of cv2's drawing functions."""


def page_size_m(target: Target) -> tuple[float, float]:
    """(width, height) of the page."""
    return target.size_m[0] + 2 * MARGIN_M, target.size_m[1] + 2 * MARGIN_M


def caption(target: Target) -> str:
    """What is printed below the pattern, so that nobody has to guess later."""
    width, height = (1000 * side for side in target.size_m)
    return f"{target.spec}   pattern {width:.1f} x {height:.1f} mm   print at 100 %, then measure it"


def svg(target: Target) -> str:
    """A page in millimetres; black on white."""
    width, height = (1000 * side for side in page_size_m(target))
    shapes = []
    for shape in target.black:
        xy = 1000 * (shape.xy_m + MARGIN_M)
        if isinstance(shape, Disc):
            shapes.append(f'<circle cx="{xy[0]:.4f}" cy="{xy[1]:.4f}" r="{1000 * shape.radius_m:.4f}"/>')
        else:
            shapes.append(f'<path d="M{"L".join(f"{x:.4f} {y:.4f}" for x, y in xy)}Z"/>')
    text = f'<text x="{1000 * MARGIN_M:.1f}" y="{height - 6:.1f}" font-size="3.2" font-family="sans-serif">'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.4f}mm" height="{height:.4f}mm" '
        f'viewBox="0 0 {width:.4f} {height:.4f}">\n<rect width="100%" height="100%" fill="#fff"/>\n'
        f'<g fill="#000" shape-rendering="crispEdges">\n{chr(10).join(shapes)}\n</g>\n{text}{caption(target)}</text>\n</svg>\n'
    )


def pdf(target: Target) -> bytes:
    """One page of true size (PDF 1.4): vector shapes and a line of text, nothing else."""
    width, height = (POINTS_PER_M * side for side in page_size_m(target))
    drawing = "\n".join(_pdf_path(shape, height) for shape in target.black)
    text = caption(target).replace("\\", "\\\\").replace("(", "\\(").replace(")", "\\)")
    content = f"0 g\n{drawing}\nf\nBT /F1 9 Tf {POINTS_PER_M * MARGIN_M:.2f} 17 Td ({text}) Tj ET\n".encode("latin-1")
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width:.4f} {height:.4f}] /Contents 4 0 R "
        "/Resources << /Font << /F1 << /Type /Font /Subtype /Type1 /BaseFont /Helvetica >> >> >> >>".encode(),
        b"<< /Length " + str(len(content)).encode() + b" >>\nstream\n" + content + b"endstream",
    ]
    out, places = bytearray(b"%PDF-1.4\n"), []
    for number, body in enumerate(objects, 1):
        places.append(len(out))
        out += str(number).encode() + b" 0 obj\n" + body + b"\nendobj\n"
    table = "".join(f"{place:010d} 00000 n \n" for place in places)
    count = len(objects) + 1
    trailer = f"xref\n0 {count}\n0000000000 65535 f \n{table}trailer\n<< /Size {count} /Root 1 0 R >>\n"
    return bytes(out) + f"{trailer}startxref\n{len(out)}\n%%EOF\n".encode()


def raster(target: Target, pixels_per_m: float, margin_m: float = MARGIN_M) -> Image:
    """(H, W) grey, anti-aliased. Pixel (i, j) is centred at ((j + 0.5) / pixels_per_m - margin_m, ...) on the board."""
    width, height = (round((side + 2 * margin_m) * pixels_per_m) for side in target.size_m)
    page = np.full((height, width), 255, np.uint8)
    scale = pixels_per_m * (1 << _SHIFT)

    def fixed(xy_m: Array) -> Array:
        return np.round((xy_m + margin_m) * scale - (1 << _SHIFT) / 2).astype(np.int32)

    for shape in target.black:
        if isinstance(shape, Disc):
            centre = tuple(fixed(shape.xy_m).tolist())
            cv2.circle(page, centre, round(shape.radius_m * scale), 0, -1, cv2.LINE_AA, _SHIFT)
        else:
            cv2.fillPoly(page, [fixed(shape.xy_m)], 0, cv2.LINE_8, _SHIFT)
    return page


def _pdf_path(shape: object, height: float) -> str:
    """y upwards, as PDF has it."""

    def at(xy_m: Array) -> str:
        x, y = POINTS_PER_M * (np.asarray(xy_m) + MARGIN_M)
        return f"{x:.4f} {height - y:.4f}"

    if isinstance(shape, Disc):
        c, r, k = shape.xy_m, shape.radius_m, _KAPPA * shape.radius_m
        turns = [((r, 0), (r, k), (k, r), (0, r)), ((0, r), (-k, r), (-r, k), (-r, 0))]
        turns += [((-r, 0), (-r, -k), (-k, -r), (0, -r)), ((0, -r), (k, -r), (r, -k), (r, 0))]
        curves = " ".join(f"{at(c + a)} {at(c + b)} {at(c + d)} c" for _, a, b, d in turns)
        return f"{at(c + (r, 0))} m {curves} h"
    corners = [at(xy) for xy in shape.xy_m]  # type: ignore[attr-defined]
    return f"{corners[0]} m " + " ".join(f"{corner} l" for corner in corners[1:]) + " h"
