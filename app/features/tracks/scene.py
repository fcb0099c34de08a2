"""What is looked at closely, in viser's scene: the selected track's rays and where its point may be; the current triple
(Figs 3 and 4) and the current pair (Figs 5 and 6), while the panel of their numbers is open."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import viser

from ispom.geometry import Array, Pose, Similarity

from ...engine.inspection.geometry import Rays, nearest_to_ray, pair, track_rays, triple
from ...engine.inspection.looked import Looked
from ...engine.inspection.selection import Selection
from ...engine.model.run_model import RunModel
from ...presentation import colours
from ...presentation.uncertainty import ellipsoid
from ...views.viser.method_scene import SHADOWLESS

ROOT = "/look"
SELECTED: colours.Rgb = (230, 159, 0)
THICK, THIN = 3.0, 1.0
"""Widths of the lines between cameras, and of those to points [px]."""
REACH_RAD = 0.012
"""How far beside a point a click still picks it: some 10 px."""


class LookScene:
    def __init__(self, api: viser.SceneApi) -> None:
        self._api = api
        self._drawn: set[str] = set()

    def show(self, looked: Looked | None, geometry: bool) -> None:
        """`geometry`: whether triple and pair are wanted."""
        wanted: dict[str, tuple[Rays, colours.Rgb]] = {}
        if looked is not None:
            wanted = _of_cameras(looked) if geometry else {}
            if looked.life is not None and looked.point is not None:
                wanted["track"] = track_rays(looked.life, looked.point.xyz_in_world), SELECTED
        nodes: set[str] = set()
        for name, (rays, colour) in wanted.items():
            assert looked is not None
            nodes |= self._draw(name, rays, colour, looked.record.placements.get(rays.method, Similarity()))
        nodes |= self._draw_spread(looked)
        for name in self._drawn - nodes:
            self._api.remove_by_name(name)
        self._drawn = nodes

    def _draw(self, name: str, rays: Rays, colour: colours.Rgb, placement: Similarity) -> set[str]:
        lines = {f"{ROOT}/{name}/points": (rays.to_points, THIN)}
        if name != "track":
            lines[f"{ROOT}/{name}/cameras"] = rays.between, THICK
        lines = {node: line for node, line in lines.items() if len(line[0])}
        for node, (segments, width_px) in lines.items():
            placed = placement.apply(segments).astype(np.float32)
            self._api.add_line_segments(node, placed, colour, thickness=width_px, thickness_units="screen")
        return set(lines)

    def _draw_spread(self, looked: Looked | None) -> set[str]:
        """The region that holds the selected track's point with 95 %."""
        if looked is None or looked.life is None or looked.point is None or looked.point.covariance is None:
            return set()
        covariance = np.zeros((6, 6))
        covariance[:3, :3] = looked.point.covariance
        found = ellipsoid(Pose(translation=looked.point.xyz_in_world), covariance)
        if found is None:
            return set()
        placement = looked.record.placements.get(looked.life.method, Similarity())
        placed = placement.apply_pose(found.pose)
        name = f"{ROOT}/track/spread"
        self._api.add_icosphere(
            name,
            color=SELECTED,
            subdivisions=2,
            opacity=0.5,
            scale=tuple((placement.scale * found.half_sizes).tolist()),
            wxyz=placed.wxyz,
            position=placed.translation,
            **SHADOWLESS,
        )
        return {name}


def clicked(looked: Looked, model: RunModel, origin: Array, direction: Array) -> Selection | None:
    """The track whose point a click's ray in the shared world passes by; None where there is none."""
    found = nearest_to_ray(model, looked, _in_worlds(model, looked.record.placements, origin, direction), REACH_RAD)
    return None if found is None else Selection("track", *found)


def _in_worlds(
    model: RunModel, placements: Mapping[str, Similarity], origin: Array, direction: Array
) -> dict[str, tuple[Array, Array]]:
    """The ray in each method's own world."""
    found: dict[str, tuple[Array, Array]] = {}
    for method in model.methods:
        placement = placements.get(method, Similarity())
        to_own = placement.pose.inverse()
        found[method] = to_own.apply(origin) / placement.scale, direction @ to_own.rotation.T
    return found


def _of_cameras(looked: Looked) -> dict[str, tuple[Rays, colours.Rgb]]:
    found = {"triple": triple(looked, looked.known_at(looked.record.index)), "pair": pair(looked)}
    return {name: (rays, colours.of(rays.method)) for name, rays in found.items() if rays is not None}
