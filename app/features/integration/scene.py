"""A stage of the integration in viser's scene."""

from __future__ import annotations

import numpy as np
import viser

from ispom.types import Step

from ...views.viser.method_scene import add_line
from .drawing import Axes, Dots, Line, Shape, drawing, extent

ROOT = "/integration"
DOT, AXIS = 0.012, 0.06
"""Sizes of a dot and of an axis, relative to all that is drawn."""


class IntegrationScene:
    """Drawn again where another stage, or another fit, is shown."""

    def __init__(self, api: viser.SceneApi) -> None:
        self._api = api
        self._shown: tuple[Step, int] | None = None
        self._names: set[str] = set()

    def show(self, step: Step | None, stage: int) -> None:
        """A stage of a fit; none where `step` is None."""
        wanted = (step, stage) if step is not None else None
        if wanted == self._shown:
            return
        self._shown = wanted
        shapes = drawing(step, stage) if step is not None else ()
        _, size = extent(shapes)
        for name in self._names - {shape.name for shape in shapes}:
            self._api.remove_by_name(f"{ROOT}/{name}")
        self._names = {shape.name for shape in shapes}
        for shape in shapes:
            self._draw(shape, size)

    def _draw(self, shape: Shape, size: float) -> None:
        name = f"{ROOT}/{shape.name}"
        match shape:
            case Line():
                add_line(self._api, name, shape.xyz, shape.colour, shape.width_px)
            case Dots():
                places, point = shape.xyz.astype(np.float32), shape.size * DOT * size
                self._api.add_point_cloud(
                    name, places, shape.colour, point_size=point, point_shape="circle", precision="float32"
                )
            case Axes():
                self._api.add_batched_axes(
                    name,
                    shape.poses.xyzw[:, [3, 0, 1, 2]],
                    shape.poses.translations,
                    axes_length=AXIS * size,
                    axes_radius=AXIS * size / 25,
                )
