"""The trajectories of other programs in viser's scene: up to the exposure shown, with a frustum where the rig is."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import viser

from ...engine.events import Opened
from ...engine.external_trajectories.placed import Placed
from ...engine.external_trajectories.places import Places
from ...engine.history.record import ExposureRecord
from ...engine.model.drawn_size import true_size
from ...engine.model.run_model import RunModel
from .method_scene import CAMERA, add_line

ROOT = "/beside"
POSES_PER_LINE = 200
"""So many are sent again when there is one more."""
WIDTH_PX = 1.8
VIEW_RAD, ASPECT = 0.8, 1.5
"""Of the frustum: what camera the other program had is not known."""


class BesideScene:
    """Draws what changed since it was drawn last."""

    def __init__(self, api: viser.SceneApi, opened: Opened) -> None:
        self._api, self._opened, self._places = api, opened, Places(opened)
        self._size = true_size(opened.truth) or 1.0
        self._drawn: dict[str, tuple[Placed, int]] = {}
        """By line: what it was drawn from, and how many of its poses."""
        self._cameras: dict[str, viser.CameraFrustumHandle] = {}

    def show(self, model: RunModel, record: ExposureRecord, hidden: frozenset[str]) -> None:
        """What is known at an exposure."""
        found = {} if "beside" in hidden else self._places.at(model, record.placements)
        wanted: set[str] = set()
        for beside in self._opened.beside:
            if (placed := found.get(beside.name)) is not None:
                wanted |= self._lines(beside.name, placed, placed.count(record.time_ns), beside.colour)
        for name in self._drawn.keys() - wanted:
            self._api.remove_by_name(name)
            del self._drawn[name]
        self._show_cameras(found, record.index)

    def _lines(self, name: str, placed: Placed, count: int, colour: tuple[int, int, int]) -> set[str]:
        wanted = set[str]()
        for start in range(0, count, POSES_PER_LINE):
            node, stop = f"{ROOT}/{name}/path/{start}", min(start + POSES_PER_LINE, count)
            wanted.add(node)
            if self._drawn.get(node) != (placed, stop):
                self._drawn[node] = placed, stop
                # Joined to the line before.
                add_line(self._api, node, placed.poses.translations[max(start - 1, 0) : stop], colour, WIDTH_PX)
        return wanted

    def _show_cameras(self, found: Mapping[str, Placed], index: int) -> None:
        for beside in self._opened.beside:
            placed = found.get(beside.name)
            pose = placed.pose(index) if placed is not None else None
            camera = self._cameras.get(beside.name)
            if pose is not None and camera is None:
                camera = self._cameras[beside.name] = self._api.add_camera_frustum(
                    f"{ROOT}/{beside.name}/camera",
                    VIEW_RAD,
                    ASPECT,
                    scale=CAMERA * self._size,
                    thickness=2.0,
                    thickness_units="screen",
                    color=beside.colour,
                )
            if camera is not None:
                camera.visible = pose is not None
            if camera is not None and pose is not None:
                camera.wxyz, camera.position = pose.wxyz, np.array(pose.translation)
