"""Small drawings over the image as SVG: in pixels, readable in both themes."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from ispom.geometry import Array

_STOPS = np.array([(68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37)], float)
"""Viridis, which is readable for colour-blind people."""
_BAR_WIDTH, _BAR_HEIGHT = 480, 120


def points(size: tuple[int, int], uv: Array, value: Array, radius: float = 1.5) -> Markup:
    """Dots, coloured from 0 to the largest value (N,)."""
    colours = _colours(value, float(value.max()) if len(value) else 1.0)
    shapes = "".join(
        f'<circle cx="{u:.1f}" cy="{v:.1f}" r="{radius}" fill="{colour}"/>'
        for (u, v), colour in zip(uv.tolist(), colours, strict=True)
    )
    return _drawing(size, shapes)


def arrows(size: tuple[int, int], uv: Array, vectors: Array, factor: float) -> Markup:
    """Lines from uv (N, 2) along vectors (N, 2), `factor` times as long."""
    ends = uv + factor * vectors
    path = "".join(
        f"M{a:.1f} {b:.1f}L{c:.1f} {d:.1f}" for (a, b), (c, d) in zip(uv.tolist(), ends.tolist(), strict=True)
    )
    return _drawing(size, f'<path d="{path}" class="line"/>')


def heat(size: tuple[int, int], px: Array) -> Markup:
    """A map (R, C) whose outermost nodes lie on the image's corners; its 90th percentile is the brightest."""
    finite = np.where(np.isfinite(px), px, np.nan)
    top = float(np.nanpercentile(finite, 90)) if np.isfinite(finite).any() else 1.0
    rows, columns = px.shape
    width, height = size[0] / columns, size[1] / rows
    shapes = []
    for i in range(rows):
        for j, colour in enumerate(_colours(px[i], top)):
            place = f'x="{j * width:.1f}" y="{i * height:.1f}" width="{width + 0.5:.1f}" height="{height + 0.5:.1f}"'
            shapes.append(f'<rect {place} fill="{colour}"><title>{px[i, j]:.3f} px</title></rect>')
    return _drawing(size, "".join(shapes))


def grid_of_counts(size: tuple[int, int], counts: NDArray[np.int64]) -> Markup:
    """How often, in each cell of the image."""
    rows, columns = counts.shape
    width, height = size[0] / columns, size[1] / rows
    top = max(float(counts.max()), 1.0)
    shapes = []
    for (i, j), count in np.ndenumerate(counts):
        x, y = j * width, i * height
        shapes.append(
            f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" class="cell" '
            f'fill-opacity="{0.8 * count / top:.2f}"/>'
            f'<text x="{x + width / 2:.1f}" y="{y + height / 2:.1f}" font-size="{height / 4:.0f}">{count}</text>'
        )
    return _drawing(size, "".join(shapes))


def bars(labels: list[str], values: list[float]) -> Markup:
    """A bar for each value, with its label where the pointer is."""
    if not values:
        return Markup("")
    width, top = _BAR_WIDTH / len(values), max([*values, 1e-12])
    shapes = []
    for k, (label, value) in enumerate(zip(labels, values, strict=True)):
        height = _BAR_HEIGHT * value / top
        place = f'x="{k * width:.2f}" y="{_BAR_HEIGHT - height:.2f}" width="{0.9 * width:.2f}" height="{height:.2f}"'
        shapes.append(f'<rect {place} class="bar"><title>{Markup.escape(label)}</title></rect>')
    return _drawing((_BAR_WIDTH, _BAR_HEIGHT), "".join(shapes))


def _colours(values: Array, top: float) -> list[str]:
    share = np.nan_to_num(np.asarray(values, float) / max(top, 1e-12), nan=1.0, posinf=1.0).clip(0, 1) * (
        len(_STOPS) - 1
    )
    low = np.minimum(share.astype(int), len(_STOPS) - 2)
    rgb = _STOPS[low] + (share - low)[:, None] * (_STOPS[low + 1] - _STOPS[low])
    return [f"#{int(r):02x}{int(g):02x}{int(b):02x}" for r, g, b in rgb]


def _drawing(size: tuple[int, int], shapes: str) -> Markup:
    return Markup(f'<svg viewBox="0 0 {size[0]} {size[1]}" role="img">{shapes}</svg>')
