"""The layout of the Rerun viewer: one 3-D view and one image, which are the stage of the page.

The page shows the legend of the image, and gives the image the room that its shape needs (stage_layout.js). To hide a
layer, the page changes paths (`hidden_paths`) in the layout that the viewer has. A new layout would reset time, camera
and tabs. Therefore the views have constant ids.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any
from uuid import NAMESPACE_URL, uuid5

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ispom.estimator import STEREO, VIDEO
from ispom.methods import method
from ispom.types import Kind

from ...engine.events import Opened
from ...engine.inspection.colouring import SCALES, Colouring
from ...engine.model.drawn_size import drawn_truth
from . import entities
from .coloured import path_of
from .eye import eye_on
from .ground import grid_below, grid_spacing
from .layers import IMAGE_LAYERS, MEASURES
from .parts import CAMERAS, image_root
from .plots import NO_ERROR, why_no_error

PLOTS = {
    "error": "error [m]",
    "scale": "scale",
    "inliers": "inliers",
    "residual": "residual [px]",
    "ms": "time [ms]",
}
LEGENDS = {"error", "scale", "ms"}
"""Plots with several lines per method. In the other plots, each line has the method's colour, as in the 3-D view."""
MARGIN = 0.4
"""Width of the room for a legend at the left, relative to the length of the run."""
IMAGES = {"video": "Video", "left": "Left", "right": "Right"}
"""Tabs of the image, by camera."""
WORLD_SHARE = 0.4
"""Share of the 3-D view in the width of the stage until the page divides it. The page's buttons are over this view."""
LEGEND_WORDS = ("words", "dark", "light")
"""Entities below a legend. Older recordings have the last two, with the words for each theme of the viewer."""


def blueprint(opened: Opened, hidden: Collection[str] = (), *, is_alone: bool = False) -> rrb.Blueprint:
    """Returns the stage: a 3-D view and one image. `hidden` names layers and methods.

    `is_alone`: for a viewer without the page; it has curves, verdicts and the time below. Such a viewer begins at the
    first frame, with an image of that frame. If that has none, as a frame of an IMU, the viewer plays in a loop from
    the first frame with an image: there is no documented way to begin there without playing.
    """
    rig = opened.sequence.rig
    hidden_in = _hidden_entities(opened.methods, hidden, "state", rig.cameras, has_legend=is_alone)
    sizes = _image_sizes(opened, is_alone)
    images = [_image(name, size, hidden_in[f"/{image_root(name)}"]) for name, size in sizes.items()]
    world = _world(opened, hidden_in["/world"], is_alone)
    first = _first_camera(opened, tuple(sizes), is_alone)
    tabs = [rrb.Tabs(*images, active_tab=list(sizes).index(first))] if images else []
    stage = rrb.Horizontal(world, *tabs, column_shares=[WORLD_SHARE, 1 - WORLD_SHARE][: 1 + bool(images)])
    stage.id = uuid5(NAMESPACE_URL, "ispom:stage")
    return rrb.Blueprint(
        rrb.Vertical(stage, _curves(opened, hidden_in), row_shares=[3, 1]) if is_alone else stage,
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        _time(opened.sequence.kinds if is_alone else ()),
        auto_layout=False,
        auto_views=False,
    )


def _time(kinds: tuple[Kind, ...]) -> rrb.TimePanel:
    """Returns the time panel. `kinds` are those of all frames, if the viewer must begin at the first with an image."""
    first = next((i for i, kind in enumerate(kinds) if CAMERAS.get(kind)), 0)
    if not first:
        return rrb.TimePanel(state="collapsed", timeline="exposure", play_state="paused")
    return rrb.TimePanel(
        state="collapsed",
        timeline="exposure",
        play_state="playing",
        loop_mode="selection",
        time_selection=rrb.components.AbsoluteTimeRange(first, len(kinds) - 1),
    )


def _image_sizes(opened: Opened, is_alone: bool = False) -> dict[str, Sequence[float]]:
    """Returns width and height of each image in the viewer's coordinates, by the name of its tab. For a viewer that
    `is_alone` they include the legend."""
    if opened.image_sizes:
        return dict(opened.image_sizes)
    rig, size_of = opened.sequence.rig, entities.shown_size if is_alone else entities.image_size
    found = {"video": rig.video, "left": rig.left, "right": rig.left if rig.has_stereo else None}
    found |= {name: camera for name, camera in rig.cameras.items() if name not in IMAGES}
    return {name: size_of(camera).tolist() for name, camera in found.items() if camera is not None}


def page_layout(opened: Opened) -> dict[str, Any]:
    """Returns what the page needs to divide the stage: the path of its container in the layout, and, by path of each
    image's view, the size of the image in the viewer's coordinates."""
    sizes = {f"/view/{_view_id(f'/{image_root(name)}')}": size for name, size in _image_sizes(opened).items()}
    return {"container": STAGE, "images": sizes}


def _first_camera(opened: Opened, cameras: tuple[str, ...], is_alone: bool) -> str:
    """Returns the camera whose image is shown first: the left one if methods use the pair and none uses the video
    camera, else the first one. In a viewer that `is_alone` it is one of the first frame, if that has images."""
    used = frozenset().union(*(method(name).sensors for name in opened.methods))
    wanted = ["left"] if used >= STEREO and not VIDEO & used else []
    kinds = [kind for kind in opened.sequence.kinds if CAMERAS.get(kind)][:1] if is_alone else []
    now = [name for kind in kinds for name in cameras if image_root(name).partition("/")[0] in CAMERAS.get(kind, ())]
    usable = now or cameras
    return next((name for name in wanted if name in usable), next(iter(usable), ""))


def _curves(opened: Opened, hidden_in: dict[str, list[str]]) -> rrb.Container:
    plots = [_plot(opened, kind, title, hidden_in[f"/plots/{kind}"]) for kind, title in PLOTS.items()]
    texts = [rrb.TextDocumentView(origin="/decisions", name="decisions"), rrb.TextLogView(origin="/log", name="log")]
    return rrb.Horizontal(
        rrb.Tabs(*map(_with_stable_id, plots)), rrb.Tabs(*map(_with_stable_id, texts)), column_shares=[1.2, 1]
    )


def hidden_paths(
    methods: Iterable[str], hidden: Collection[str], colour_by: Colouring = "state", cameras: Iterable[str] = ()
) -> list[str]:
    """Returns the paths in the layout whose `EntityBehavior.visible` must be false to hide these layers and methods,
    and all other colourings of tracks. Legends are always among them, because the page has its own. `cameras` are the
    ones in addition to the video camera and the pair."""
    return [
        _override(origin, path)
        for origin, paths in _hidden_entities(methods, hidden, colour_by, cameras).items()
        for path in paths
    ]


def hidden_in_world(entity: str) -> str:
    """Returns such a path for one entity of the 3-D view that is no layer."""
    return _override("/world", entity)


def _override(origin: str, entity: str) -> str:
    return f"/view/{_view_id(origin)}/ViewContents/overrides/{entity}/visualizers"


def send(stream: rr.RecordingStream, opened: Opened, hidden: Collection[str] = ()) -> None:
    """Makes this the viewer's layout now."""
    with released(blueprint(opened, hidden)) as layout:
        stream.send_blueprint(layout, make_active=True, make_default=True)


@contextmanager
def released(layout: rrb.Blueprint) -> Iterator[rrb.Blueprint]:
    """Gives the layout to be passed to Rerun in this context, and frees what Rerun makes of it afterwards.

    Rerun logs a layout to a stream in memory. Unless it is disconnected, this stream and its two threads stay until the
    process ends.
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


def _hidden_entities(
    methods: Iterable[str],
    hidden: Collection[str],
    colour_by: Colouring,
    cameras: Iterable[str],
    *,
    has_legend: bool = False,
) -> dict[str, list[str]]:
    """Returns the hidden entities of each view, by the origin of the view."""
    methods = tuple(methods)
    gone = [m for m in methods if m in hidden]
    others = ["beside"] if "beside" in hidden else []
    layers = {
        "truth": ["world/truth"],
        "beside": ["world/beside"],
        "cameras": [*(f"world/{m}/camera" for m in methods), "world/view", "world/truth/rig"],
        "error": [f"world/{m}/error" for m in methods],
        "uncertainty": [f"world/{m}/uncertainty" for m in methods],
        "key_frames": [f"world/{m}/key_frames" for m in methods],
        "clouds": [f"world/{m}/cloud" for m in methods],
        "depth": [f"world/{m}/depth" for m in methods],
        "overlay": [f"world/{m}/lines" for m in methods],
        "map": [f"world/{m}/{part}" for m in methods for part in ("map", "laser")],
    }
    world = [path for layer, paths in layers.items() if layer in hidden for path in paths]
    images = {name: [*_hidden_in_image(name, hidden, colour_by, has_legend)] for name in IMAGES}
    roots = sorted({image_root(name) for name in cameras} - images.keys())
    images |= {
        root: [f"{root}/{entity}" for layer, entity in IMAGE_LAYERS.items() if layer in hidden] for root in roots
    }
    unplotted = [*methods, "beside"] if MEASURES in hidden else gone + others
    texts = ["decisions", "log"] if MEASURES in hidden else []
    return (
        {"/world": world + [f"world/{part}{m}" for m in gone for part in ("", "view/")]}
        | {f"/{name}": paths for name, paths in images.items()}
        | {f"/plots/{kind}": [f"plots/{kind}/{m}" for m in unplotted] for kind in PLOTS}
        | {f"/{text}": [text] for text in texts}
    )


def _hidden_in_image(camera: str, hidden: Collection[str], colour_by: Colouring, has_legend: bool) -> Iterator[str]:
    """Yields hidden layers, and all colourings of the tracks except one. The words of legends are listed by themselves,
    because an entity that was shown once stays visible below a hidden one."""
    by_state = {"tracks"} if colour_by != "state" else set()
    if camera == "right":
        yield from (f"right/{IMAGE_LAYERS[layer]}" for layer in ("tracks", "overlay") if layer in hidden)
        return
    yield from (f"{camera}/{entity}" for layer, entity in IMAGE_LAYERS.items() if layer in by_state.union(hidden))
    yield from (path_of(camera, by) for by in SCALES if by != colour_by or "tracks" in hidden)
    for by in ("state", *SCALES):
        if not has_legend or by != colour_by:
            yield from (_legend(camera, by), *(f"{_legend(camera, by)}/{words}" for words in LEGEND_WORDS))


def _legend(camera: str, by: str) -> str:
    return f"{camera}/legend" if by == "state" else f"{camera}/coloured/{by}/legend"


def _world(opened: Opened, hidden: list[str], is_alone: bool) -> rrb.View:
    truth = drawn_truth(opened.truth, opened.methods)
    path = truth.translations if truth is not None else np.zeros((0, 3))
    eye = eye_on(path, least_size(opened))
    controls = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital, position=eye.position, look_target=eye.target, eye_up=eye.up
    )
    if is_alone and truth is None:  # the extent of the paths is unknown; the viewer frames what is drawn
        controls = None
    unit = "m" if any(method(name).unit == "metric" for name in opened.methods) else "own unit, not metres"
    if opened.truth is not None and truth is None:
        unit += f"; true path aligned by {'SE(3)' if unit == 'm' else 'Sim(3)'}"
    in_metres = opened.truth if unit.startswith("m") else None
    spacing = grid_spacing(path if in_metres is None else in_metres.translations)
    grid = grid_below(path, least_size(opened), spacing)
    name = f"3-D [{unit}], grid {spacing:g}{' m' if unit == 'm' else ''}"
    view = rrb.Spatial3DView(origin="/world", name=name, overrides=_hide(hidden), eye_controls=controls, line_grid=grid)
    return _with_stable_id(view)


def least_size(opened: Opened) -> float:
    """Returns the extent of the smallest scene that is framed: a few cameras."""
    rig = opened.sequence.rig
    return 10.0 * rig.baseline_m if rig.has_stereo else 2.0


def _image(name: str, size: Sequence[float], hidden: list[str]) -> rrb.View:
    width, height = size
    bounds = rrb.VisualBounds2D(x_range=(0, width), y_range=(0, height))
    root = image_root(name)
    title = IMAGES.get(name, name)
    view = rrb.Spatial2DView(origin=f"/{root}", name=title, overrides=_hide(hidden), visual_bounds=bounds)
    return _with_stable_id(view)


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
    """Returns an axis with room for the legend before the whole run; None for a live source, whose end is unknown."""
    if opened.sequence.grow is not None or not len(opened.sequence):
        return None
    end = len(opened.sequence) - 1
    start, end = (rr.TimeRangeBoundary.absolute(seq=i) for i in (-round(MARGIN * end), end))
    return rrb.archetypes.TimeAxis(view_range=rr.TimeRange(start=start, end=end))


def _hide(paths: list[str]) -> dict[Any, rrb.EntityBehavior]:
    return {path: rrb.EntityBehavior(visible=False) for path in paths}


def _with_stable_id(view: rrb.View) -> rrb.View:
    """Returns the view with an id that depends only on what it shows, so that it is the same in every layout."""
    view.id = _view_id(str(view.origin))
    return view


def _view_id(origin: str) -> Any:
    return uuid5(NAMESPACE_URL, f"ispom:{origin}")


STAGE = f"/container/{uuid5(NAMESPACE_URL, 'ispom:stage')}"
"""Where the layout has the 3-D view and the images."""
EYE = f"/view/{_view_id('/world')}/EyeControls3D"
"""Where the layout has the eye of the 3-D view."""
