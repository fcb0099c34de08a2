"""Geometry: the numbers of the current triple (Figs 3 and 4) and the current pair (Figs 5 and 6).

The 3-D scene draws both while this panel is open.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...engine.inspection.geometry import Rays, pair, triple
from ...engine.inspection.looked import Looked
from ...presentation import colours
from ...presentation.texts import length
from ...views.viser.panels import renderer

render = renderer(__package__)


def geometry_report(looked: Looked) -> str:
    """As HTML."""
    of_video, of_stereo = triple(looked, looked.known_at(looked.record.index)), pair(looked)
    parts = [
        ("Triple: keyframes", of_video, [] if of_video is None else list(_triple(of_video, looked))),
        ("Pair: exposure", of_stereo, [] if of_stereo is None else list(_pair(of_stereo, looked))),
    ]
    found = [
        {
            "title": f"{title} {', '.join(map(str, rays.indices))}",
            "label": colours.label(rays.method),
            "colour": colours.css(colours.of(rays.method)),
            "facts": facts,
        }
        for title, rays, facts in parts
        if rays is not None
    ]
    return render("geometry.html", parts=found)


def _triple(rays: Rays, looked: Looked) -> Iterator[tuple[str, str]]:
    """|T| are the distances of section 6.1; where the camera turns, |T13| - |T12| is less than |T23|."""
    t12, t13, t23 = rays.lengths
    for name, value in (("|T12|", t12), ("|T13|", t13), ("|T23|", t23)):
        yield name, _size(value, rays, looked)
    yield "|T13|-|T12|", f"{_size(t13 - t12, rays, looked)}, {100 * (t13 - t12) / max(t23, 1e-12):.1f} % of |T23|"
    yield from _points(rays, looked)


def _pair(rays: Rays, looked: Looked) -> Iterator[tuple[str, str]]:
    yield "baseline", _size(float(rays.lengths[0]), rays, looked)
    yield from _points(rays, looked)


def _points(rays: Rays, looked: Looked) -> Iterator[tuple[str, str]]:
    if not len(rays.points):
        yield "points", "none that all of them saw has a place"
        return
    away = np.linalg.norm(rays.points - rays.centres[-1], axis=1)
    near, far = _size(float(away.min()), rays, looked), _size(float(away.max()), rays, looked)
    yield "points", f"{len(rays.points)} drawn, {near} to {far} away"
    low, high = rays.parallax_deg().min(), rays.parallax_deg().max()
    yield "parallax", f"{low:.2f}° to {high:.2f}°"


def _size(value: float, rays: Rays, looked: Looked) -> str:
    unit_m = looked.unit_m(rays.method)
    return f"{value:.4g} units" if unit_m is None else length(unit_m * value)
