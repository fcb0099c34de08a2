"""What a click in a view of the stage means: a track to select, or a frame to show."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Array, Similarity
from ispom.types import FrameName

from ...engine.inspection.selection import Selection
from ...engine.inspection.sightings import camera_pose, missing_tracks, nearest, seen_by
from ...session.current_run import CurrentRun
from ...views.rerun import entities
from ...views.rerun.parts import latest_of_each_camera

SEEN_OF_WIDTH = 0.02
"""How near a track has to be to where a point is seen, in widths of the image."""
Meaning = Selection | int | None
"""A frame is given by its index."""


def meaning(
    run: CurrentRun, path: str, index: int, position: tuple[float | None, ...], instance: int | None
) -> Meaning:
    """Of a click on an entity while a frame is shown: `position` is in image pixels as Rerun counts them, or in the
    shared world. None where it means nothing. InputError where the image has no tracks to select."""
    if not 0 <= index < len(run.history):
        return None
    path = path.removeprefix("/")
    camera = path.partition("/")[0]
    at = np.array([np.nan if value is None else value for value in position])
    if camera in ("video", "left", "right"):
        return _in_image(run, camera, index, at[:2]) if np.isfinite(at[:2]).all() else None
    if found := re.fullmatch(r"world/([^/]+)/(cloud|key_frames|path)/(\d+)", path):
        method, kind, block = found[1], found[2], int(found[3])
        if method not in run.opened.methods:
            return None
        if kind == "cloud" and instance is not None and method in _following(run, index):
            blocks = run.known_at(index).methods[method].points.blocks
            ids = blocks[block].ids if block < len(blocks) else np.zeros(0, np.int64)
            return Selection("track", method, int(ids[instance])) if 0 <= instance < len(ids) else None
        if kind != "cloud" and np.isfinite(at).all():
            return _on_path(run, method, index, at, only_key_frames=kind == "key_frames")
    if not path.startswith("world/") or not np.isfinite(at).all():
        return None
    return _in_world(run, index, at) or _where_it_is_seen(run, index, at)


def _in_image(run: CurrentRun, camera: str, index: int, shown_uv: Array) -> Selection:
    """The track nearest to the click."""
    name: FrameName = "video" if camera == "video" else "left"
    frame = latest_of_each_camera(run.opened.sequence.kinds, index).get(camera)
    seen = seen_by(run.history[frame], camera=name) if frame is not None else None
    shape = run.opened.sequence.rig.camera(name)
    uv = shown_uv / entities.shown_scale(shape.width, shape.height) - 0.5
    if seen is None and frame is not None and run.is_recorded(frame):
        raise InputError(missing_tracks(run.history[frame], recorded=True))
    if seen is not None and camera == "right":
        seen = replace(seen, tracks=entities.in_right(seen.tracks))
    number = nearest(seen, uv) if seen is not None else None
    if seen is None or number is None:
        raise InputError(f"frame {index} has no tracks of the {camera} camera to select: click into another image")
    return Selection("track", seen.step.method, number)


def _on_path(run: CurrentRun, method: str, index: int, at: Array, *, only_key_frames: bool) -> int | None:
    """The frame whose pose is nearest."""
    known, times = run.known_at(index).methods[method].poses, run.known_at(index).times
    own = run.history[index].placements.get(method, Similarity()).inverse().apply(at)
    xyz = np.concatenate([np.zeros((0, 3)), *(block.positions for block in known.blocks)])
    usable = [block.known & block.key if only_key_frames else block.known for block in known.blocks]
    rows = np.flatnonzero(np.concatenate([np.zeros(0, bool), *usable]))
    if not len(rows):
        return None
    row = rows[np.argmin(np.linalg.norm(xyz[rows] - own, axis=1))]
    return int(times.indices(np.array([row]))[0])


def _in_world(run: CurrentRun, index: int, at: Array) -> Selection | None:
    """The landmark nearest to the click, of all methods that follow tracks themselves."""
    best, found = np.inf, None
    model, placements = run.known_at(index), run.history[index].placements
    for method in _following(run, index):
        known = model.methods[method]
        placement = placements.get(method, Similarity())
        for block in known.points.blocks:
            distances = np.linalg.norm(placement.apply(block.xyz.astype(float)) - at, axis=1)
            row = int(np.argmin(distances))
            if distances[row] < best:
                best, found = float(distances[row]), Selection("track", method, int(block.ids[row]))
    return found


def _where_it_is_seen(run: CurrentRun, index: int, at: Array) -> Selection | None:
    """The track nearest to where the cameras see a point: a method that leaves tracks to the methods inside it has its
    own numbers for points."""
    rig, nearest_px, found = run.opened.sequence.rig, np.inf, None
    for frame in set(latest_of_each_camera(run.opened.sequence.kinds, index).values()):
        record, seen = run.history[frame], seen_by(run.history[frame])
        step = next((step for step in record.steps if step.world_from_frame is not None), None)
        pose = camera_pose(step, rig, seen.camera) if seen is not None and step is not None else None
        if seen is None or step is None or pose is None:
            continue
        own = record.placements.get(step.method, Similarity()).inverse().apply(at[None])
        xyz, camera = pose.inverse().apply(own), rig.camera(seen.camera)
        uv = camera.project(xyz)[0]
        if xyz[0, 2] > 0 and (number := nearest(seen, uv)) is not None:
            distance_px = float(np.linalg.norm(seen.tracks.uv[seen.tracks.ids == number][0] - uv))
            if distance_px < min(nearest_px, SEEN_OF_WIDTH * camera.width):
                nearest_px, found = distance_px, Selection("track", seen.step.method, number)
    return found


def _following(run: CurrentRun, index: int) -> list[str]:
    """Methods that follow tracks themselves, by their latest steps."""
    frames = set(latest_of_each_camera(run.opened.sequence.kinds, index).values())
    found = {step.method for frame in frames for step in run.history[frame].steps if step.tracks}
    return [method for method in run.opened.methods if method in found]
