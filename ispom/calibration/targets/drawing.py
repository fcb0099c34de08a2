"""Targets on paper: SVG and PDF of true size, and images of them for the simulation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.calibration.targets.target import Disc, Rectangle, Target
from ispom.geometry import Array
from ispom.types import Image

MARGIN_M = 0.02
"""White around the pattern."""
POINTS_PER_M = 72 / 0.0254
_KAPPA = 0.5522847498
"""Length of the handles of the four Bezier curves that make a circle, of its radius."""


def page_size_m(target: Target) -> tuple[float, float]:
    """(width, height) of the page."""
    return target.size_m[0] + 2 * MARGIN_M, target.size_m[1] + 2 * MARGIN_M


def caption(target: Target) -> str:
    """Returns the text below the pattern, which identifies it."""
    width, height = (1000 * side for side in target.size_m)
    return f"{target.spec}   pattern {width:.1f} x {height:.1f} mm   print at 100 %, then measure it"


def svg(target: Target) -> str:
    """Returns a page in millimetres; black on white."""
    width, height = (1000 * side for side in page_size_m(target))
    shapes = []
    for shape in target.black:
        if isinstance(shape, Disc):
            x, y = 1000 * (shape.xy_m + MARGIN_M)
            shapes.append(f'<circle cx="{x:.4f}" cy="{y:.4f}" r="{1000 * shape.radius_m:.4f}"/>')
        else:
            (x, y), (w, h) = 1000 * (shape.low_m + MARGIN_M), 1000 * (shape.high_m - shape.low_m)
            shapes.append(f'<rect x="{x:.4f}" y="{y:.4f}" width="{w:.4f}" height="{h:.4f}"/>')
    text = f'<text x="{1000 * MARGIN_M:.1f}" y="{height - 6:.1f}" font-size="3.2" font-family="sans-serif">'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.4f}mm" height="{height:.4f}mm" '
        f'viewBox="0 0 {width:.4f} {height:.4f}">\n<rect width="100%" height="100%" fill="#fff"/>\n'
        f'<g fill="#000" shape-rendering="crispEdges">\n{chr(10).join(shapes)}\n</g>\n'
        f"{text}{caption(target)}</text>\n</svg>\n"
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
    """Draws (H, W) grey, anti-aliased; pixel (i, j) is centred at ((j + 0.5) / pixels_per_m - margin_m, ...) on the
    board."""
    width, height = (round((side + 2 * margin_m) * pixels_per_m) for side in target.size_m)
    page = np.zeros((height, width), np.float32)
    for shape in target.black:
        if isinstance(shape, Disc):
            _add_disc(page, (shape.xy_m + margin_m) * pixels_per_m, shape.radius_m * pixels_per_m)
        else:
            _add_rectangle(page, *((xy + margin_m) * pixels_per_m for xy in (shape.low_m, shape.high_m)))
    return np.round(255 * (1 - page.clip(0, 1))).astype(np.uint8)


def _add_rectangle(page: NDArray[np.float32], low: Array, high: Array) -> None:
    """Adds the share of each pixel that it covers; pixel j reaches from j to j + 1."""
    shares, places = [], []
    for a, b, size in zip(low, high, page.shape[::-1], strict=True):
        first, last = max(0, int(np.floor(a))), min(size, int(np.ceil(b)))
        j = np.arange(first, last)
        shares.append((np.minimum(j + 1, b) - np.maximum(j, a)).clip(0, 1))
        places.append(slice(first, last))
    page[places[1], places[0]] += np.outer(shares[1], shares[0]).astype(np.float32)


def _add_disc(page: NDArray[np.float32], centre: Array, radius: float) -> None:
    """Its edge one pixel wide."""
    first = np.maximum(np.floor(centre - radius - 1), 0).astype(int)
    last = np.minimum(np.ceil(centre + radius + 1), page.shape[::-1]).astype(int)
    x, y = np.arange(first[0], last[0]) + 0.5, np.arange(first[1], last[1]) + 0.5
    distance = np.hypot(x[None] - centre[0], y[:, None] - centre[1])
    page[first[1] : last[1], first[0] : last[0]] += (radius - distance + 0.5).clip(0, 1).astype(np.float32)


def _pdf_path(shape: Rectangle | Disc, height: float) -> str:
    """y upwards, as PDF has it."""

    def at(xy_m: Array) -> str:
        x, y = POINTS_PER_M * (xy_m + MARGIN_M)
        return f"{x:.4f} {height - y:.4f}"

    if isinstance(shape, Disc):
        c, r, k = shape.xy_m, shape.radius_m, _KAPPA * shape.radius_m
        turns = [((r, k), (k, r), (0, r)), ((-k, r), (-r, k), (-r, 0))]
        turns += [((-r, -k), (-k, -r), (0, -r)), ((k, -r), (r, -k), (r, 0))]
        curves = " ".join(f"{' '.join(at(c + np.array(xy)) for xy in turn)} c" for turn in turns)
        return f"{at(c + np.array([r, 0]))} m {curves} h"
    (low_x, low_y), (high_x, high_y) = shape.low_m, shape.high_m
    corners = [at(np.array(xy)) for xy in ((low_x, low_y), (high_x, low_y), (high_x, high_y), (low_x, high_y))]
    return f"{corners[0]} m {corners[1]} l {corners[2]} l {corners[3]} l h"
