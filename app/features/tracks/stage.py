"""What is looked at closely, on the stage: the selected track in its images, its rays and where its point may be; the
current triple (Figs 3 and 4) and the current pair (Figs 5 and 6), while the panel of their numbers is open."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import rerun as rr

from ispom.geometry import Array, Pose, Similarity

from ...engine.inspection.geometry import Rays, pair, track_rays, triple
from ...engine.inspection.looked import Looked
from ...engine.inspection.sightings import seen_by
from ...presentation import colours
from ...presentation.uncertainty import ellipsoid
from ...views.rerun import entities
from ...views.rerun.batch import Entry

ROOT = "world/look"
SELECTED: colours.Rgb = (255, 193, 7)
THICK, THIN, OF_TRACK, POINT_PX = 1.25, 0.5, 0.75, 5.0
"""Half widths on the screen: of lines between cameras, of those to points, of a track's, and of its point."""
RING_PX, RING_OF_WIDTH = 1.25, 0.012
"""Half width of the ring around the selected track, and its radius in widths of the image."""
CORNERS = np.linspace(0, 2 * np.pi, 33)


def in_images(looked: Looked) -> Iterator[Entry]:
    """A ring around each selected track, in the image of each camera that sees it in its frame shown."""
    selection = looked.selection
    if selection is None or not selection.tracks:
        return
    for name in looked.cameras:
        kind = "stereo" if name == "left" else "video"
        kinds = looked.sequence.kinds
        index = next((i for i in range(looked.record.index, -1, -1) if kinds[i] == kind), None)
        seen = None if index is None else seen_by(looked.records[index], selection.method, name)
        rows = np.flatnonzero(np.isin(seen.tracks.ids, selection.tracks)) if seen is not None else []
        if seen is not None and len(rows):
            camera = looked.of_camera(name)
            radius = RING_OF_WIDTH * entities.shown_scale(camera.width, camera.height) * camera.width
            circle = radius * np.stack([np.cos(CORNERS), np.sin(CORNERS)], 1)
            rings = [entities.shown_uv(uv, camera) + circle for uv in seen.tracks.uv[rows]]
            style = {"colors": SELECTED, "radii": -RING_PX, "draw_order": 60}
            style |= {"labels": f"track {selection.number}"} if len(selection.tracks) == 1 else {}
            yield Entry(f"{name}/selected", rr.LineStrips2D(rings, **style))


def in_world(looked: Looked, *, geometry: bool) -> Iterator[Entry]:
    """`geometry`: whether triple and pair are wanted."""
    if geometry:
        for name, rays in (("triple", triple(looked, looked.known_at(looked.record.index))), ("pair", pair(looked))):
            if rays is not None:
                yield from _rays(looked, name, rays)
    if looked.life is None or looked.point is None:
        return
    rays = track_rays(looked.life, looked.point.xyz_in_world)
    placement = _placement(looked, rays.method)
    if len(rays.to_points):
        lines = entities.lines(placement.apply(rays.to_points), SELECTED, OF_TRACK)
        yield Entry(f"{ROOT}/track/rays", lines)
    at = placement.apply(looked.point.xyz_in_world[None])
    yield Entry(f"{ROOT}/track/point", rr.Points3D(at, colors=SELECTED, radii=-POINT_PX))
    if looked.point.covariance is not None:
        yield from _region(looked.point.xyz_in_world, looked.point.covariance, placement)


def _rays(looked: Looked, name: str, rays: Rays) -> Iterator[Entry]:
    placement, colour = _placement(looked, rays.method), colours.of(rays.method)
    for part, segments, width in (("points", rays.to_points, THIN), ("cameras", rays.between, THICK)):
        if len(segments):
            yield Entry(f"{ROOT}/{name}/{part}", entities.lines(placement.apply(segments), colour, width))


def _region(xyz: Array, covariance: Array, placement: Similarity) -> Iterator[Entry]:
    """The region that holds the selected track's point with 95 %."""
    of_pose = np.zeros((6, 6))
    of_pose[:3, :3] = covariance
    found = ellipsoid(Pose(translation=xyz), of_pose)
    if found is not None:
        placed = placement.apply_pose(found.pose)
        yield Entry(
            f"{ROOT}/track/region",
            rr.Ellipsoids3D(
                half_sizes=[placement.scale * found.half_sizes],
                centers=[placed.translation],
                quaternions=[placed.xyzw],
                colors=SELECTED,
                line_radii=[-0.5],
                fill_mode="majorwireframe",
            ),
        )


def _placement(looked: Looked, method: str) -> Similarity:
    return looked.record.placements.get(method, Similarity())
