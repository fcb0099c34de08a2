"""The layout of the Rerun viewer: nothing needs arranging.

A layer is hidden by paths of the layout (`hidden_paths`), which the page sets in the layout as the viewer has it: a new
layout would take back time, camera and tabs. The views keep their ids for that.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from typing import Any
from uuid import NAMESPACE_URL, uuid5

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ispom.geometry import Array
from ispom.methods import method
from ispom.types import Trajectory

from ...engine.events import Opened
from ...engine.inspection.colouring import SCALES, Colouring
from ...engine.model.drawn_size import drawn_truth
from . import entities
from .coloured import path_of
from .layers import IMAGE_LAYERS, MEASURES
from .plots import NO_ERROR, why_no_error

PLOTS = {
    "error": "error [m]",
    "scale": "scale",
    "inliers": "inliers",
    "residual": "residual [px]",
    "ms": "time [ms]",
}
LEGENDS = {"error", "scale", "ms"}
"""Plots with more than a line per method: the others' colours are the methods', which the page shows all the time."""
MARGIN = 0.4
"""Room for a legend at the left, as a fraction of the run."""


def blueprint(opened: Opened, hidden: Collection[str] = ()) -> rrb.Blueprint:
    """3-D at the left, images at the right, plots and text below. `hidden` names layers and methods."""
    rig, kept = opened.sequence.rig, _hidden_entities(opened.methods, hidden, "state")
    images = [
        _image(opened, name, title, kept[f"/{name}"])
        for name, title in (("video", "video, tracks"), ("left", "left image, tracks and disparity"))
        if (rig.video if name == "video" else rig.left) is not None
    ]
    plots = [_plot(opened, kind, title, kept[f"/plots/{kind}"]) for kind, title in PLOTS.items()]
    texts = [rrb.TextDocumentView(origin="/decisions", name="decisions"), rrb.TextLogView(origin="/log", name="log")]
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(_world(opened, kept["/world"]), rrb.Vertical(*images), column_shares=[1.65, 1]),
            rrb.Horizontal(rrb.Tabs(*map(_lasting, plots)), rrb.Tabs(*map(_lasting, texts)), column_shares=[1.2, 1]),
            row_shares=[2, 1],
        ),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline="exposure", play_state="paused"),
        auto_layout=False,
        auto_views=False,
    )


def hidden_paths(methods: Iterable[str], hidden: Collection[str], colour_by: Colouring = "state") -> list[str]:
    """Paths in the layout whose `EntityBehavior.visible` is false when these layers and methods are hidden, and tracks
    are coloured so."""
    return [
        f"/view/{_view_id(origin)}/ViewContents/overrides/{path}/visualizers"
        for origin, paths in _hidden_entities(methods, hidden, colour_by).items()
        for path in paths
    ]


def looking_at(truth: Trajectory | None) -> tuple[Array, Array]:
    """Position and target (3,) of a camera behind and above, the whole true path in sight; without truth, the first
    metres ahead."""
    xyz = truth.translations if truth is not None and len(truth) else np.array([[-5.0, 0, 0], [5.0, 0, 15.0]])
    low, high = xyz.min(0), xyz.max(0)
    centre, extent = (low + high) / 2, max(float(np.linalg.norm(high - low)), 2.0)
    return centre + extent * np.array([-0.35, -0.6, -0.75]), centre


def send(stream: rr.RecordingStream, opened: Opened, hidden: Collection[str] = ()) -> None:
    """Makes this the viewer's layout now."""
    with released(blueprint(opened, hidden)) as layout:
        stream.send_blueprint(layout, make_active=True, make_default=True)


@contextmanager
def released(layout: rrb.Blueprint) -> Iterator[rrb.Blueprint]:
    """The layout, to be handed to Rerun meanwhile: what Rerun makes of it is freed afterwards.

    Rerun logs a layout to a stream in memory, which holds itself and two threads until the process ends, unless it is
    disconnected.
    """
    log, used = layout._log_to_stream, list[rr.RecordingStream]()

    def log_to_stream(stream: rr.RecordingStream) -> None:
        used.append(stream)
        log(stream)

    layout._log_to_stream = log_to_stream
    try:
        yield layout
    finally:
        for stream in used:
            stream.disconnect()


def _hidden_entities(methods: Iterable[str], hidden: Collection[str], colour_by: Colouring) -> dict[str, list[str]]:
    """By the origin of each view: which of its entities are hidden."""
    methods = tuple(methods)
    gone = [m for m in methods if m in hidden]
    others = ["beside"] if "beside" in hidden else []
    layers = {
        "truth": ["world/truth"],
        "beside": ["world/beside"],
        "cameras": [*(f"world/{m}/camera" for m in methods), "world/truth/rig"],
        "uncertainty": [f"world/{m}/uncertainty" for m in methods],
        "key_frames": [f"world/{m}/key_frames" for m in methods],
        "clouds": [f"world/{m}/cloud" for m in methods],
        "map": [f"world/{m}/{part}" for m in methods for part in ("map", "laser")],
    }
    world = [path for layer, paths in layers.items() if layer in hidden for path in paths]
    images = {name: [*_hidden_in_image(name, hidden, colour_by)] for name in ("video", "left")}
    unplotted = [*methods, "beside"] if MEASURES in hidden else gone + others
    texts = ["decisions", "log"] if MEASURES in hidden else []
    return (
        {"/world": world + [f"world/{m}" for m in gone]}
        | {f"/{name}": paths for name, paths in images.items()}
        | {f"/plots/{kind}": [f"plots/{kind}/{m}" for m in unplotted] for kind in PLOTS}
        | {f"/{text}": [text] for text in texts}
    )


def _hidden_in_image(camera: str, hidden: Collection[str], colour_by: Colouring) -> Iterator[str]:
    """Layers, and all but one way to colour the tracks."""
    by_state = {"tracks", "legend"} if colour_by != "state" else set()
    yield from (f"{camera}/{layer}" for layer in (*IMAGE_LAYERS, "legend") if layer in by_state.union(hidden))
    yield from (path_of(camera, by) for by in SCALES if by != colour_by or "tracks" in hidden)


def _world(opened: Opened, hidden: list[str]) -> rrb.View:
    truth = drawn_truth(opened.truth, opened.methods)
    position, target = looking_at(truth)
    eye = rrb.EyeControls3D(kind=rrb.Eye3DKind.Orbital, position=position, look_target=target, eye_up=(0, -1, 0))
    unit = "m" if any(method(name).unit == "metric" for name in opened.methods) else "own unit, not metres"
    if opened.truth is not None and truth is None:
        unit += "; true path aligned by Sim(3)"
    view = rrb.Spatial3DView(
        origin="/world", name=f"world [{unit}]", overrides=_hide(hidden), eye_controls=eye, line_grid=False
    )
    return _lasting(view)


def _image(opened: Opened, name: str, title: str, hidden: list[str]) -> rrb.View:
    width, height = entities.shown_size(opened.sequence.rig.camera("video" if name == "video" else "left"))
    bounds = rrb.VisualBounds2D(x_range=(0, width), y_range=(0, height))
    return _lasting(rrb.Spatial2DView(origin=f"/{name}", name=title, overrides=_hide(hidden), visual_bounds=bounds))


def _plot(opened: Opened, kind: str, title: str, hidden: list[str]) -> rrb.View:
    if kind == "error" and why_no_error(opened):
        return rrb.TextDocumentView(origin=NO_ERROR, name=title)
    explained = kind in LEGENDS
    return rrb.TimeSeriesView(
        origin=f"/plots/{kind}",
        name=title,
        overrides=_hide(hidden),
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=explained),
        axis_x=_room_for_legend(opened) if explained else None,
    )


def _room_for_legend(opened: Opened) -> rrb.archetypes.TimeAxis | None:
    """The whole run, with the legend before it. A live source has no end to plan with."""
    if opened.sequence.grow is not None or not len(opened.sequence):
        return None
    end = len(opened.sequence) - 1
    start, end = (rr.TimeRangeBoundary.absolute(seq=i) for i in (-round(MARGIN * end), end))
    return rrb.archetypes.TimeAxis(view_range=rr.TimeRange(start=start, end=end))


def _hide(paths: list[str]) -> dict[Any, rrb.EntityBehavior]:
    return {path: rrb.EntityBehavior(visible=False) for path in paths}


def _lasting(view: rrb.View) -> rrb.View:
    """With an id that follows from what it shows, in every layout the same."""
    view.id = _view_id(str(view.origin))
    return view


def _view_id(origin: str) -> Any:
    return uuid5(NAMESPACE_URL, f"ispom:{origin}")
