"""What a map is made from: a run's poses, and the images that it ran on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ispom.errors import InputError
from ispom.io.files import exists
from ispom.io.maps import SceneMap, read_maps
from ispom.io.trajectories import read_tum
from ispom.methods import method as registered
from ispom.types import Sequence, Status, Trajectory

from ...engine.run_folder.placements import placed
from ...engine.run_folder.results import in_frame, segments_of
from ...engine.run_folder.run_file import RunFile, read_run_file
from ...engine.run_folder.run_folder import LANDMARKS, trajectory_file
from ...engine.run_folder.statistics import RunStatistics
from ...engine.run_folder.step_reader import stored_steps
from ...session.review.stored import stored_source

PREFERRED = ("integrated", "stereo", "integrated.paper", "stereo.paper")
"""Metric methods, the best first; those with a unit of their own come after all metric ones."""
PREFERRED_OWN = ("monocular", "sfm", "monocular.paper")
NEARER = 0.1
"""Share of the observed points that may be nearer than a dense model of one camera begins: few points are outliers."""


@dataclass(frozen=True, eq=False)
class Ran:
    """A run, opened again."""

    folder: Path
    file: RunFile
    sequence: Sequence
    paths: Mapping[str, Trajectory]
    """world_from_rig of each metric method; without the poses that it only held while it was lost."""
    own: Mapping[str, tuple[Trajectory, ...]]
    """world_from_video of each segment of the methods with a unit of their own, in the order of time, likewise; an
    empty one where a segment has held poses only."""

    def method(self, method_name: str | None) -> str:
        """Returns the method of this name, by default that with the best poses.

        Raises InputError for one that has no poses in the run."""
        known = [*self.paths, *self.own]
        if method_name is None:
            return next((name for name in (*PREFERRED, *self.paths, *PREFERRED_OWN) if name in known), known[0])
        if method_name not in known:
            raise InputError(
                f"{self.folder} has no poses of {method_name[:40]}: give --method as one of {', '.join(known)}"
            )
        return method_name

    def segment(self, method_name: str, number: int | None) -> int:
        """Returns the index of a segment of a method with a unit of its own: that of the number (from 1, as in
        METHOD.N.tum), by default the one with the most poses. Raises InputError for a number that it lacks."""
        counts = [len(segment) for segment in self.own[method_name]]
        if number is None:
            return int(np.argmax(counts))
        if not 1 <= number <= len(counts):
            raise InputError(f"{method_name} has {len(counts)} segments in {self.folder}: give --segment from 1 on")
        return number - 1

    def near_depth(self, method_name: str, path: Trajectory) -> float:
        """Returns the depth from which on most of the scene is: NEARER of the method's points in the keyframes of the
        path are nearer; in its unit.

        Raises InputError where the run has no such points: then nothing says how far the scene is.
        """
        scene = read_maps(self.folder / LANDMARKS).get(method_name)
        depth = None if scene is None else _near_depth(scene, path)
        if depth is None:
            raise InputError(
                f"{self.folder} has no points of {method_name}, which say how far the scene is: "
                "give --method as one that makes a map, such as monocular"
            )
        return depth


def _near_depth(scene: SceneMap, path: Trajectory) -> float | None:
    """Of all observations in front of their keyframes; None without any."""
    landmarks, keys = scene.landmarks, scene.key_frames
    order = np.searchsorted(landmarks.ids, scene.seen_ids)
    known = np.isin(scene.seen_ids, landmarks.ids) & np.isin(keys.times_ns, path.times_ns)[scene.seen_from]
    seen_from, points = scene.seen_from[known], landmarks.xyz_in_world[order[known]]
    depths = np.einsum("ni,ni->n", keys.rotations[seen_from][:, :, 2], points - keys.translations[seen_from])
    depths = depths[depths > 0]  # NaN is not
    return float(np.quantile(depths, NEARER)) if len(depths) else None


def _counted(folder: Path, methods: list[str]) -> tuple[dict[str, list[int]], RunStatistics]:
    """By method: the times [ns] at which it had no pose of its own; and where segments begin."""
    lost: dict[str, list[int]] = {method: [] for method in methods}
    statistics = RunStatistics()
    with stored_steps(folder) as steps:
        for step in steps:
            if step.method not in lost:
                continue
            status, joins = str(step.values["status"]), step.values.get("joins")
            statistics.count(
                step.method,
                step.time_ns,
                0.0,
                status,
                bool(step.values["restarted"]),
                int(joins) if isinstance(joins, float) else None,
            )
            if status == Status.LOST:
                lost[step.method].append(step.time_ns)
    return lost, statistics


def read_ran(folder: Path, source: str | None) -> Ran:
    """InputError where the folder holds no run with poses, or its source is gone or another one now."""
    run = read_run_file(folder)
    methods = [m for m in run.methods if exists(folder / trajectory_file(m))]
    if not methods:
        raise InputError(f"{folder} has no poses: run a method on a recording with motion")
    sequence = stored_source(folder, run, source).open()
    units = {method: placement.scale for at, method, placement in placed(run.placements) if at > 0}
    lost, statistics = _counted(folder, methods)
    paths: dict[str, Trajectory] = {}
    own: dict[str, tuple[Trajectory, ...]] = {}
    for name in methods:
        written = read_tum(folder / trajectory_file(name), run.frame)
        if not np.isin(written.times_ns, sequence.times_ns).all():
            raise InputError(f"{source or run.source} is not the source that the run had: its frames have other times")
        if registered(name).unit == "metric":
            path = in_frame(_without(written, lost[name]), sequence.rig, "rig")
            paths |= {name: path} if len(path) > 1 else {}
        else:
            path = in_frame(written, sequence.rig, "video", units.get(name))
            found = tuple(_without(part, lost[name]) for part in segments_of(path, statistics.segments(name)))
            own |= {name: found} if any(len(part) > 1 for part in found) else {}
    if not paths and not own:
        raise InputError(f"{folder}: no method found two poses: run again on a recording with motion")
    return Ran(folder, run, sequence, paths, own)


def _without(path: Trajectory, times_ns: list[int]) -> Trajectory:
    return path.select(~np.isin(path.times_ns, times_ns))
