"""Track: the life of the selected one, its point, and how far each image disagrees with it."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from typing import Any

import numpy as np

from ispom.types import Image, TrackStatus

from ...engine.inspection.looked import Looked
from ...engine.inspection.sightings import Observation, TrackLife
from ...presentation import colours
from ...presentation.texts import length
from ...views.viser.drawing import picture
from ...views.viser.panels import renderer
from .track_picture import image_of, line_of

render = renderer(__package__)

CHIPS, CHIP_PX = 12, 48
PLOT = (330.0, 60.0)
"""Width and height of the residuals' plot."""
MOST_KEPT = 60
NOTHING = "Nothing is selected: click on a track in the picture, on a row under Tracks, or on a point in the 3-D scene."


class TrackChips:
    """Cut out of images as they are read again; the latest are kept."""

    def __init__(self) -> None:
        self._pictures: OrderedDict[tuple[Any, ...], str] = OrderedDict()

    def of(self, looked: Looked, observation: Observation) -> str:
        """The surroundings of an observation, as an address of an image; empty where it cannot be read."""
        key = (id(looked.sequence), observation.index, *np.round(observation.uv, 1).tolist())
        if key not in self._pictures:
            image = image_of(looked.sequence, observation.index)
            self._pictures[key] = "" if image is None else picture(cut(image, observation.uv), CHIP_PX)
        self._pictures.move_to_end(key)
        while len(self._pictures) > MOST_KEPT:
            self._pictures.popitem(last=False)
        return self._pictures[key]


def cut(image: Image, uv: np.ndarray) -> Image:
    """CHIP_PX x CHIP_PX around a pixel; what lies outside the image repeats its edge."""
    half = CHIP_PX // 2
    u, v = np.rint(uv).astype(int)
    columns = np.clip(np.arange(u - half, u + half), 0, image.shape[1] - 1)
    rows = np.clip(np.arange(v - half, v + half), 0, image.shape[0] - 1)
    return image[np.ix_(rows, columns)]


def spread(life: TrackLife, most: int = CHIPS) -> list[int]:
    """Indices of some of its observations, evenly spread, with the first and the last."""
    count = len(life.observations)
    return sorted(set(np.rint(np.linspace(0, count - 1, min(most, count))).astype(int).tolist()))


def track_report(looked: Looked, chips: TrackChips) -> str:
    """As HTML."""
    selection, life = looked.selection, looked.life
    if selection is None or selection.kind != "track":
        return render("track.html", note=NOTHING, life=None)
    if life is None:
        note = f"Track {selection.number} is not among the tracks of the frames up to {looked.record.index}."
        return render("track.html", note=note, life=None)
    now = np.full(len(life.observations), np.nan) if looked.point is None else looked.point.residuals_px
    items = [_chip(looked, chips, life.observations[i], now[i]) for i in spread(life)]
    title = f"Track {life.number} of {colours.label(life.method)}, {life.camera} image"
    facts = list(_facts(looked, life))
    return render("track.html", note="", life=title, chips=items, facts=facts, plot=_plot(life, now))


def _chip(looked: Looked, chips: TrackChips, observation: Observation, residual_px: float) -> dict[str, Any]:
    residual = "" if np.isnan(residual_px) else f", {residual_px:.2f} px from its point"
    return {
        "image": chips.of(looked, observation),
        "index": observation.index,
        "colour": colours.css(colours.TRACK[observation.status]),
        "hint": f"frame {observation.index}: {observation.status.reason}{residual}",
        "key": observation.key_frame,
    }


def _facts(looked: Looked, life: TrackLife) -> Iterator[tuple[str, str]]:
    first, last = life.observations[0], life.last
    began = f"frame {first.index}" if life.whole else f"frame {first.index} or earlier"
    if last.status.dropped:
        yield "ended", f"frame {last.index}: {last.status.reason}; began at {began}"
    else:
        gap = "" if last.index == looked.index else f", last seen at {last.index}"
        yield "state", f"{last.status.reason} since {began}, seen {len(life.seen)} times{gap}"
    steps = np.linalg.norm(np.diff([s.uv for s in life.seen], axis=0), axis=1) if len(life.seen) > 1 else np.zeros(1)
    yield "2-D path", f"{steps.sum():.1f} px, {steps.mean():.2f} px per frame"
    yield from _epipolar(looked, life)
    yield from _point(looked, life)


def _epipolar(looked: Looked, life: TrackLife) -> Iterator[tuple[str, str]]:
    views = [s for s in life.seen if s.world_from_camera is not None]
    line = line_of(looked)
    if line is None:
        yield "epipolar", "needs two frames with a pose"
    elif np.isnan(line.distance_px):
        yield "epipolar", f"no line: the camera did not move between {views[0].index} and {views[-1].index}"
    else:
        where = f"of frame {views[0].index} in frame {views[-1].index} (yellow)"
        yield "epipolar", f"{line.distance_px:.2f} px from the line {where}"


def _point(looked: Looked, life: TrackLife) -> Iterator[tuple[str, str]]:
    point = looked.point
    if point is None:
        yield "point", "unknown: no landmark, and the observations do not fix its distance"
        return
    unit_m, last = looked.unit_m(life.method), life.seen[-1] if life.seen else None
    origin = "intersected here" if point.from_exposure is None else f"landmark of frame {point.from_exposure}"
    yield "point", f"({', '.join(_size(x, unit_m) for x in point.xyz_in_world)}), {origin}"
    if last is not None and last.world_from_camera is not None:
        yield "depth", _size(float(last.world_from_camera.inverse().apply(point.xyz_in_world)[2]), unit_m)
    if point.covariance is not None:
        sigmas = np.sqrt(np.maximum(np.linalg.eigvalsh(point.covariance)[::-1], 0))
        axes = " × ".join(_size(float(s), unit_m) for s in sigmas)
        yield "1 sigma", f"{axes}, for {looked.sigma_px:.2f} px per coordinate and exact poses"
    if np.isfinite(point.residuals_px).any():
        rms = float(np.sqrt(np.nanmean(point.residuals_px**2)))
        yield "residual", f"RMS {rms:.2f} px over {np.isfinite(point.residuals_px).sum()} frames"


def _size(value: float, unit_m: float | None) -> str:
    return f"{value:.4g} units" if unit_m is None else length(unit_m * value)


def _plot(life: TrackLife, now_px: np.ndarray) -> dict[str, Any] | None:
    """The residuals over the observations: with the point as known at the frame shown, and with the live one."""
    then_px = np.array([np.nan if s.status == TrackStatus.NEW else s.residual_px for s in life.observations])
    known = np.concatenate([now_px, then_px])
    if len(now_px) < 2 or not np.isfinite(known).any():
        return None
    top = max(float(np.nanmax(known)), 1e-3)
    x = np.arange(len(now_px)) / (len(now_px) - 1) * PLOT[0]
    lines = [_line(x, values / top) for values in (now_px, then_px)]
    ends = life.observations[0].index, life.last.index
    return {
        "width": PLOT[0],
        "height": PLOT[1],
        "now": lines[0],
        "then": lines[1],
        "top": f"{top:.2f} px",
        "ends": ends,
    }


def _line(x: np.ndarray, fraction: np.ndarray) -> str:
    """A path with a gap where nothing is known."""
    parts, drawing = [], False
    for a, b in zip(x.tolist(), fraction.tolist(), strict=True):
        if np.isfinite(b):
            parts.append(f"{'L' if drawing else 'M'}{a:.1f} {PLOT[1] * (1 - b):.1f}{'' if drawing else 'h0.01'}")
        drawing = bool(np.isfinite(b))
    return "".join(parts)
