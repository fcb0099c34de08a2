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
from ispom.estimators.modern.monocular.key_frame import ITERATIONS
from ispom.estimators.modern.monocular.localise import Localisation, located_by
from ispom.estimators.modern.monocular.map import Map, adjusted
from ispom.estimators.modern.monocular.setup import INLIER, Setup
from ispom.estimators.modern.monocular.tracks import LiveTracks, scene_points
from ispom.estimators.modern.rolling import AHEAD, LEAST, PASSES, SPAN_S, Sight, at_middle, late_px, late_s, motion_at
from ispom.geometry import Array, Pose
from ispom.solvers.localisation import fit_pose

AROUND = 5
"""Number of poses of the polynomial, for frames before the newest one (see rolling.AHEAD)."""
LEAST_LATE_S = 1e-4
"""Least time [s] from the middle row for a difference quotient; nearer rows use this one."""


def speeds_by(
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


def begun_by_motions(setup: Setup, world: Map, sights: tuple[Sight, ...]) -> Map:
    """Corrects all frames of a first map, which used the tracks' velocities, by its poses, and optimises it. Returns it
    unchanged for a global shutter."""
    if not setup.camera.line_delay_s:
        return world
    return adjusted(with_motions(setup, world, sights), setup.noise.width, ITERATIONS)[0]


def by_motions(
    setup: Setup, live: LiveTracks, world: Map, sights: tuple[Sight, ...], time_ns: int, found: Localisation
) -> tuple[Localisation, Map]:
    """Localises a frame again with the motion of the poses, and corrects the map's last frames, of these sights, with
    its pose. Returns both unchanged for a global shutter."""
    if not setup.camera.line_delay_s:
        return found, world
    found = located_by_motion(setup, live, world, time_ns, found)
    if found.motion is None:
        return found, world
    newest = (time_ns, found.motion.camera_from_world.inverse())
    if world.keys[-1].time_ns != sights[-1].time_ns:
        return found, with_motions(setup, world, sights, (newest,))
    for _ in range(PASSES):
        right = adjusted(with_motions(setup, world, sights, (newest,)), setup.noise.width, ITERATIONS)[0]
        again = replace(located_by(setup, live, right, found.followed, newest[1]), compared=found.compared)
        again = located_by_motion(setup, live, right, time_ns, again)
        if again.motion is None or not again.agreeing:
            break
        world, found, newest = right, again, (time_ns, again.motion.camera_from_world.inverse())
    return found, world


def located_by_motion(setup: Setup, live: LiveTracks, world: Map, time_ns: int, found: Localisation) -> Localisation:
    """Localises a frame again, with its tracks moved to the time of the middle row; unchanged if there are too few
    poses."""
    before = world.since(time_ns - round(SPAN_S * 1e9))[1 - AHEAD :]
    if len(before) + 1 < LEAST:
        return found
    lens = Lens(setup.camera, world.extra)
    for _ in range(PASSES):
        if found.motion is None:
            break
        pose = found.motion.camera_from_world
        motion = motion_at([*before, (time_ns, pose.inverse())], time_ns)
        uv = found.followed.uv
        scene = scene_points(lens, uv, world.known(live.ids), pose.inverse())
        followed = replace(found.followed, speed=speeds_by(lens, uv, scene, pose, motion))
        again = located_by(setup, live, world, followed, pose.inverse())
        if not again.agreeing:
            break
        found = replace(again, compared=found.compared)
    return found


def with_motions(setup: Setup, world: Map, sights: tuple[Sight, ...], newest: tuple[tuple[int, Pose], ...] = ()) -> Map:
    """Corrects the frames of these sights, ordered by time, by the motion of the poses around each. `newest` are not in
    the map."""
    poses = [*world.since(sights[0].time_ns - round(SPAN_S * 1e9)), *newest]
    known = dict(poses)
    for sight in sights:
        around = _around(poses, sight.time_ns) if sight.time_ns in known else []
        if len(around) >= LEAST:
            world = _anew(setup, world, sight, known[sight.time_ns], motion_at(around, sight.time_ns))
    return world


def _around(poses: list[tuple[int, Pose]], time_ns: int) -> list[tuple[int, Pose]]:
    """Returns the poses of the polynomial at the time of one of them, if possible as many after it as before it."""
    span_ns = SPAN_S * 1e9
    near = [item for item in poses if abs(item[0] - time_ns) <= span_ns]
    count = [t for t, _ in near].index(time_ns) + 1 + AROUND // 2
    count = min(max(count, AROUND), len(near))
    found = near[max(0, count - AROUND) : count]
    while found[-1][0] - found[0][0] > span_ns:
        found = found[1:] if time_ns - found[0][0] >= found[-1][0] - time_ns else found[:-1]
    return found


def _anew(setup: Setup, world: Map, sight: Sight, world_from_camera: Pose, motion: Array) -> Map:
    """Replaces the coordinates of a keyframe, for the next optimisation, or localises another frame again."""
    lens, xyz = Lens(setup.camera, world.extra), world.known(sight.ids)
    pose, scene = world_from_camera.inverse(), scene_points(lens, sight.uv, xyz, world_from_camera)
    uv = sight.uv - late_px(setup.camera, sight.uv, speeds_by(lens, sight.uv, scene, pose, motion))
    if any(k.time_ns == sight.time_ns for k in world.keys):
        return world.with_updated_coordinates(sight.time_ns, sight.ids, setup.camera.normalise(uv))
    has, limit = np.isfinite(xyz[:, 0]), INLIER * setup.noise.width
    found = fit_pose(xyz[has], lens.normalise(uv[has]), pose, limit / 2, limit)
    return world if found is None else world.moved(sight.time_ns, found.camera_from_world.inverse())
