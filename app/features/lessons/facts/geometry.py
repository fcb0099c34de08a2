"""What single steps of a run say of geometry: points, triples of keyframes, and segments of an integration."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ispom.errors import InputError
from ispom.solvers.trajectory.stages import Stage, stages
from ispom.types import Step, Tracks

from ....engine.history.quantities import by_method
from ..ran import Ran

TURN_LEFT = 0.05
"""A triple whose |T13 - T12| is a smaller share of |T13| says nothing of its ratio."""


def focal_times_baseline(ran: Ran) -> float:
    """Of the stereo pair [m px]: a depth is this over its disparity."""
    return ran.sequence.rig.camera("left").fx * ran.sequence.rig.baseline_m


def doubled_world_px(ran: Ran, method: str) -> float:
    """How far the images of its points move where points and path are twice as large [px], the farthest of all."""
    steps = [step for step in _steps(ran, method) if len(step.landmarks)]
    maps = [(s.frame, s.world_from_frame, s.landmarks.xyz_in_world) for s in steps if s.world_from_frame is not None]
    if not maps:
        raise InputError(f"{method} has found no points: there is nothing to enlarge")
    camera, farthest = ran.sequence.rig.camera(maps[0][0]), 0.0
    for _, pose, xyz in maps:
        seen = camera.project(pose.inverse().apply(xyz))
        seen_double = camera.project((2 * xyz - 2 * pose.translation) @ pose.rotation)
        farthest = max(farthest, float(np.nanmax(np.linalg.norm(seen - seen_double, axis=1))))
    return farthest


def printed_over_vector(ran: Ran, method: str) -> float:
    """(|T13| - |T12|) / |T13 - T12| over all triples of its keyframes: the median."""
    path = ran.path(method)
    keys = ran.series.values(f"{method}.key_frame", 0, ran.count) == 1
    found = path.select(np.isin(path.times_ns, ran.sequence.times_ns[: ran.count][keys])).translations
    t12, t13 = found[1:-1] - found[:-2], found[2:] - found[:-2]
    lengths, vector = np.linalg.norm(t13, axis=1), np.linalg.norm(t13 - t12, axis=1)
    printed = lengths - np.linalg.norm(t12, axis=1)
    good = vector > TURN_LEFT * lengths
    if not good.any():
        raise InputError(f"{method} has no three keyframes in this run: take a longer source")
    return float(np.median(printed[good] / vector[good]))


def stage_gap_m(ran: Ran, method: str, kind: str) -> float:
    """How far a segment's end is from the stereo pose after a stage of the fit [m]: the median of all segments."""
    return float(np.median([stage.gap_m for stage in _stages(ran, method, kind)]))


def stage_turn_deg(ran: Ran, method: str, kind: str) -> float:
    """Between the segment's vector and that of the stereo poses [deg], likewise."""
    return float(np.degrees(np.median([stage.direction_rad for stage in _stages(ran, method, kind)])))


def stage_orientation_deg(ran: Ran, method: str, kind: str) -> float:
    """By which its last orientation misses the stereo pose's [deg], likewise."""
    return float(np.degrees(np.median([stage.orientation_rad for stage in _stages(ran, method, kind)])))


def image_motion_px(ran: Ran, method: str, camera: str) -> float:
    """From one image of a camera to the next, the median of all tracks."""
    moved = [np.linalg.norm(t.uv - t.uv_prev, axis=1) for t in _tracks(ran, method, camera)]
    found = np.concatenate([each[np.isfinite(each)] for each in moved])
    if not len(found):
        raise InputError(f"{method} follows no track in the {camera} camera")
    return float(np.median(found))


def clock_ms(ran: Ran, method: str) -> float:
    """How late the video camera's clock is, as the method found it last [ms]."""
    found = [m.late_s for step in _steps(ran, method) if (m := step.calibration.mount) is not None]
    if not found:
        raise InputError(f"{method} says nothing of the clock: switch its estimate on")
    return 1000 * float(found[-1])


def points(ran: Ran, method: str) -> float:
    """How many different points of the scene it placed."""
    return float(len(set().union(*(step.landmarks.ids.tolist() for step in _steps(ran, method)))))


def _steps(ran: Ran, method: str) -> Iterator[Step]:
    for i in range(ran.count):
        step = by_method(ran.records[i].steps).get(method)
        if step is not None:
            yield step


def _tracks(ran: Ran, method: str, camera: str) -> Iterator[Tracks]:
    return (step.tracks[camera] for step in _steps(ran, method) if camera in step.tracks)


def _stages(ran: Ran, method: str, kind: str) -> list[Stage]:
    fits = (stages(fit) for step in _steps(ran, method) for fit in step.segments)
    found = [stage for fit in fits for stage in fit if stage.kind == kind]
    if not found:
        raise InputError(f"{method} has fitted no segment up to the stage {kind!r} in this run")
    return found
