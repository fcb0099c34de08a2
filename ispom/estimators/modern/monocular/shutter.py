"""Rolling shutter with a map: moves observations to the time of the middle row by the camera's motion. The last two
frames are corrected once more, as poses on both sides of a frame give its motion ten times better. If this changes the
newest keyframe, the map is optimised at once, as it localises all frames up to the next keyframe.

The motion at a frame, velocity and acceleration, is that of the polynomial through the poses around it. It is not
estimated from the frame's own rows: a wrong motion bends the map, and seems right in a bent map.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.lens import Lens
from ispom.estimators.modern.monocular.keyframe import ITERATIONS
from ispom.estimators.modern.monocular.localise import Localisation, localise_by_tracks
from ispom.estimators.modern.monocular.map import Map, TracksInMap, optimise
from ispom.estimators.modern.monocular.setup import INLIER, Setup
from ispom.estimators.modern.monocular.track import scene_points
from ispom.estimators.modern.rolling import (
    AHEAD,
    LEAST,
    PASSES,
    SPAN_S,
    RollingTracks,
    at_middle,
    late_px,
    late_s,
    motion_at,
)
from ispom.geometry import Array, Pose
from ispom.solvers.localisation import fit_pose

NEIGHBOUR_POSES = 5
"""Number of poses of the polynomial, for frames before the newest one (see rolling.AHEAD)."""
LEAST_LATE_S = 1e-4
"""Least time [s] from the middle row for a difference quotient; nearer rows use this one."""


def speeds_by_motion(
    lens: Lens, uv: NDArray[np.float32], scene: Array, camera_from_world: Pose, motion: Array
) -> NDArray[np.float32]:
    """Returns the velocities (N, 2) [px/s] with which `late_px` moves points `uv` (N, 2) of the scene (N, 3) to the
    time of the middle row; `motion` (12,) as of `motion_at`."""
    late = late_s(lens.camera, uv[:, 1].astype(float))
    late = np.where(np.abs(late) < LEAST_LATE_S, LEAST_LATE_S, late)
    depth = camera_from_world.apply(scene)[:, 2]
    far = np.where(depth > 1e-6, 1 / np.maximum(depth, 1e-6), 0.0)
    ray = np.column_stack([lens.normalise(uv), np.ones(len(uv))])
    way = uv - lens.project(at_middle(ray, late, motion, far))
    return np.where(np.isfinite(way), way / late[:, None], 0.0).astype(np.float32)


def correct_first_map(setup: Setup, local_map: Map, rolling_tracks: tuple[RollingTracks, ...]) -> Map:
    """Corrects all frames of a first map, which used the tracks' velocities, by its poses, and optimises it. Returns it
    unchanged for a global shutter."""
    if not setup.camera.line_delay_s:
        return local_map
    return optimise(correct_frames(setup, local_map, rolling_tracks), setup.noise.width, ITERATIONS)[0]


def correct_by_motion(
    tracks: TracksInMap, recent: tuple[RollingTracks, ...], time_ns: int, localisation: Localisation
) -> tuple[Localisation, Map]:
    """Localises a frame again with the motion of the poses, and corrects the map's last frames, of the `recent` tracks,
    with its pose. Returns both unchanged for a global shutter."""
    setup = tracks.setup
    if not setup.camera.line_delay_s:
        return localisation, tracks.map
    localisation = localise_by_motion(tracks, time_ns, localisation)
    if localisation.fit is None:
        return localisation, tracks.map
    newest = (time_ns, localisation.fit.camera_from_world.inverse())
    if tracks.map.keys[-1].time_ns != recent[-1].time_ns:
        return localisation, correct_frames(setup, tracks.map, recent, (newest,))
    for _ in range(PASSES):
        local_map = optimise(correct_frames(setup, tracks.map, recent, (newest,)), setup.noise.width, ITERATIONS)[0]
        corrected = replace(tracks, map=local_map)
        again = localise_by_tracks(corrected, localisation.tracked, newest[1])
        again = localise_by_motion(corrected, time_ns, replace(again, compared=localisation.compared))
        if again.fit is None or not again.has_enough_inliers:
            break
        tracks, localisation, newest = corrected, again, (time_ns, again.fit.camera_from_world.inverse())
    return localisation, tracks.map


def localise_by_motion(tracks: TracksInMap, time_ns: int, localisation: Localisation) -> Localisation:
    """Localises a frame again, with its tracks moved to the time of the middle row; unchanged if there are too few
    poses."""
    before = tracks.map.since(time_ns - round(SPAN_S * 1e9))[1 - AHEAD :]
    if len(before) + 1 < LEAST:
        return localisation
    for _ in range(PASSES):
        if localisation.fit is None:
            break
        pose, uv = localisation.fit.camera_from_world, localisation.tracked.uv
        motion = motion_at([*before, (time_ns, pose.inverse())], time_ns)
        scene = scene_points(tracks.lens, uv, tracks.xyz, pose.inverse())
        speed = speeds_by_motion(tracks.lens, uv, scene, pose, motion)
        again = localise_by_tracks(tracks, replace(localisation.tracked, speed=speed), pose.inverse())
        if not again.has_enough_inliers:
            break
        localisation = replace(again, compared=localisation.compared)
    return localisation


def correct_frames(
    setup: Setup, local_map: Map, rolling_tracks: tuple[RollingTracks, ...], newest: tuple[tuple[int, Pose], ...] = ()
) -> Map:
    """Corrects the frames of these tracks, ordered by time, by the motion of the poses around each. `newest` are not in
    the map."""
    poses = [*local_map.since(rolling_tracks[0].time_ns - round(SPAN_S * 1e9)), *newest]
    known = dict(poses)
    for tracks in rolling_tracks:
        around = _neighbour_poses(poses, tracks.time_ns) if tracks.time_ns in known else []
        if len(around) >= LEAST:
            local_map = _correct_frame(
                setup, local_map, tracks, known[tracks.time_ns], motion_at(around, tracks.time_ns)
            )
    return local_map


def _neighbour_poses(poses: list[tuple[int, Pose]], time_ns: int) -> list[tuple[int, Pose]]:
    """Returns the poses of the polynomial at the time of one of them, if possible as many after it as before it."""
    span_ns = SPAN_S * 1e9
    near = [item for item in poses if abs(item[0] - time_ns) <= span_ns]
    count = [t for t, _ in near].index(time_ns) + 1 + NEIGHBOUR_POSES // 2
    count = min(max(count, NEIGHBOUR_POSES), len(near))
    found = near[max(0, count - NEIGHBOUR_POSES) : count]
    while found[-1][0] - found[0][0] > span_ns:
        found = found[1:] if time_ns - found[0][0] >= found[-1][0] - time_ns else found[:-1]
    return found


def _correct_frame(setup: Setup, local_map: Map, tracks: RollingTracks, world_from_camera: Pose, motion: Array) -> Map:
    """Replaces the coordinates of a keyframe, for the next optimisation, or localises another frame again."""
    lens, xyz = Lens(setup.camera, local_map.extra), local_map.known(tracks.ids)
    pose, scene = world_from_camera.inverse(), scene_points(lens, tracks.uv, xyz, world_from_camera)
    uv = tracks.uv - late_px(setup.camera, tracks.uv, speeds_by_motion(lens, tracks.uv, scene, pose, motion))
    if any(k.time_ns == tracks.time_ns for k in local_map.keys):
        return local_map.with_updated_coordinates(tracks.time_ns, tracks.ids, setup.camera.normalise(uv))
    has, limit = np.isfinite(xyz[:, 0]), INLIER * setup.noise.width
    found = fit_pose(xyz[has], lens.normalise(uv[has]), pose, limit / 2, limit)
    return local_map if found is None else local_map.moved(tracks.time_ns, found.camera_from_world.inverse())
