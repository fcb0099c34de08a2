"""Poses of a camera as they were known at an exposure: later steps revise them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.geometry import Pose
from ispom.types import Frame, Rig

from ..model.poses import POSES_PER_BLOCK
from ..model.run_model import RunModel
from .sightings import TrackLife


def revised(life: TrackLife, model: RunModel, rig: Rig) -> TrackLife:
    """With the poses that the model knows, in place of those given at each exposure.

    A method that runs only for another one is not in the model: its poses stay as they were given.
    """
    if life.method not in model.methods:
        return life
    found = []
    for sighting in life.sightings:
        pose = pose_at(model, life.method, sighting.time_ns, rig, life.camera)
        known = sighting.world_from_camera is not None and pose is not None
        found.append(replace(sighting, world_from_camera=pose) if known else sighting)
    return replace(life, sightings=tuple(found))


def pose_at(model: RunModel, method: str, time_ns: int, rig: Rig, camera: Frame) -> Pose | None:
    """world_from_camera of a method of the model at the time of an exposure; None where it has no pose there."""
    poses, times = model.methods[method].poses, model.times
    row = int(times.rows(np.array([time_ns]))[0])
    block, at = divmod(row, POSES_PER_BLOCK)
    if block >= len(poses.blocks) or not poses.blocks[block].known[at]:
        return None
    if not times.count or int(times.times_ns(slice(row, row + 1))[0]) != time_ns:
        return None
    return poses.pose(row) @ rig.rig_from(poses.frame).inverse() @ rig.rig_from(camera)
