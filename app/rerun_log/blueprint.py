"""The layout of the Rerun viewer: nothing needs arranging."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ..run.events import Opened
from . import entities

LAYERS = ("truth", "cameras", "spread", "key_frames", "clouds", "tracks", "trails", "disparity")
"""What can be hidden beside the methods."""


def blueprint(opened: Opened, hidden: Collection[str] = ()) -> rrb.Blueprint:
    """3-D at the left, images at the right, plots and text below. `hidden` names LAYERS and methods."""
    images = [
        _image(opened, name, title, hidden)
        for name, title in (("video", "video"), ("left", "left image"))
        if (opened.sequence.rig.video if name == "video" else opened.sequence.rig.left) is not None
    ]
    texts = [
        rrb.TextDocumentView(origin="/decisions", name="decisions"),
        rrb.TextLogView(origin="/log", name="log"),
    ]
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(_world(opened, hidden), rrb.Vertical(*images), column_shares=[1.65, 1]),
            rrb.Horizontal(rrb.Tabs(*_plots(opened, hidden)), rrb.Tabs(*texts), column_shares=[1.3, 1]),
            row_shares=[2.3, 1],
        ),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline="time", play_state="following"),
        auto_layout=False,
        auto_views=False,
    )


def _world(opened: Opened, hidden: Collection[str]) -> rrb.Spatial3DView:
    methods = opened.methods
    paths = {
        "truth": ["world/truth"],
        "cameras": [f"world/{m}/camera" for m in methods] + ["world/truth/rig"],
        "spread": [f"world/{m}/spread" for m in methods],
        "key_frames": [f"world/{m}/key_frames" for m in methods],
        "clouds": [f"world/{m}/cloud" for m in methods],
        **{m: [f"world/{m}"] for m in methods},
    }
    return rrb.Spatial3DView(
        origin="/world",
        name="world [m]",
        overrides=_hide([p for layer in paths if layer in hidden for p in paths[layer]]),
        eye_controls=_eye(opened),
        line_grid=False,
    )


def _image(opened: Opened, name: str, title: str, hidden: Collection[str]) -> rrb.Spatial2DView:
    camera = opened.sequence.rig.camera("video" if name == "video" else "left")
    width, height = entities.shown_size(camera)
    return rrb.Spatial2DView(
        origin=f"/{name}",
        name=f"{title}, tracks and disparity" if name == "left" else f"{title}, tracks",
        overrides=_hide([f"{name}/{layer}" for layer in ("tracks", "trails", "disparity") if layer in hidden]),
        visual_bounds=rrb.VisualBounds2D(x_range=(0, width), y_range=(0, height)),
    )


def _plots(opened: Opened, hidden: Collection[str]) -> list[rrb.TimeSeriesView]:
    titles = {
        "error": "position error [m]",
        "scale": "scale ratio",
        "inliers": "inliers",
        "residual": "residual [px]",
        "ms": "ms per stage",
    }
    return [
        rrb.TimeSeriesView(
            origin=f"/plots/{kind}",
            name=title,
            overrides=_hide([f"plots/{kind}/{m}" for m in opened.methods if m in hidden]),
            plot_legend=rrb.Corner2D.LeftTop,
        )
        for kind, title in titles.items()
    ]


def _hide(paths: list[str]) -> dict[Any, rrb.EntityBehavior]:
    return {path: rrb.EntityBehavior(visible=False) for path in paths}


def _eye(opened: Opened) -> rrb.EyeControls3D:
    """From behind and above, the whole true path in sight; without truth, the first metres ahead."""
    xyz = opened.truth.translations if opened.truth is not None else np.array([[-5.0, 0, 0], [5.0, 0, 15.0]])
    low, high = xyz.min(0), xyz.max(0)
    centre, extent = (low + high) / 2, max(float(np.linalg.norm(high - low)), 2.0)
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=centre + extent * np.array([-0.35, -0.6, -0.75]),
        look_target=centre,
        eye_up=(0, -1, 0),
    )


def send(stream: rr.RecordingStream, opened: Opened, hidden: Collection[str] = ()) -> None:
    """Makes this the viewer's layout now."""
    stream.send_blueprint(blueprint(opened, hidden), make_active=True, make_default=True)
