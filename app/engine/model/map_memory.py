"""What `ispom run` keeps of the scene: lines, and the observations of keyframes. From these and the final poses it
computes landmarks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ispom.io.maps import CAMERAS, SceneMap
from ispom.solvers.multiview.structure import intersected
from ispom.types import FrameName, Landmarks, Rig, Step, Tracks, TrackStatus, Trajectory, WorldLines

_Colours = tuple[NDArray[np.int64], NDArray[np.uint8]]
"""Ids (M,) and RGB (M, 3)."""


@dataclass
class MapCollector:
    """Collects the map of one method: some 40 bytes for each observation of a keyframe.

    Positions of landmarks are not kept: those of a step hold for the poses of its time, which may be revised.
    """

    camera: FrameName | None = None
    lines: WorldLines = field(default_factory=WorldLines.empty)
    """The newest lines."""
    _colours: list[_Colours] = field(default_factory=list)
    _seen: dict[int, Tracks] = field(default_factory=dict)

    def add(self, step: Step) -> None:
        """Takes the tracks of a keyframe and their colours, from the step or from its part that tracks the video."""
        if len(step.world_lines):
            self.lines = step.world_lines
        part = step if step.tracks else next((p for p in step.parts if "video" in p.tracks), step)
        placed = np.isfinite(part.landmarks.xyz_in_world).all(axis=1)
        if placed.any():
            self._add_colours(part.landmarks.ids[placed], part.landmarks.rgb[placed])
        name: FrameName | None = next((camera for camera in CAMERAS if camera in part.tracks), None)
        if name is not None and part.key_frame:
            tracks = part.tracks[name]
            alive = tracks.status < TrackStatus.LOST
            self.camera = name
            self._seen[step.time_ns] = Tracks.of(
                tracks.ids[alive], tracks.uv[alive], disparity_px=tracks.disparity_px[alive]
            )

    def scene(self, trajectory: Trajectory, rig: Rig) -> SceneMap:
        """Returns the map with the final poses of the keyframes, and landmarks that are intersected from these poses.

        Keyframes without a final pose are skipped, and so are landmarks whose distance the poses do not determine.
        """
        camera = self.camera or ("video" if rig.video is not None else "left")
        times = [t for t in trajectory.times_ns.tolist() if t in self._seen]
        keys = trajectory.select(np.isin(trajectory.times_ns, np.array(times, np.int64)))
        keys = keys.moved(right=rig.rig_from(trajectory.frame).inverse() @ rig.rig_from(camera), frame=camera)
        views = [Tracks.of(np.zeros(0), np.zeros((0, 2))), *(self._seen[t] for t in times)]
        ids, uv, disparity_px = (
            np.concatenate([getattr(view, name) for view in views]) for name in ("ids", "uv", "disparity_px")
        )
        seen_from = np.repeat(np.arange(len(times)), [len(view) for view in views[1:]])
        landmarks = self._landmarks(keys, rig, (seen_from, ids, uv, disparity_px))
        return SceneMap(landmarks, keys, seen_from, ids, uv, self.lines)

    def _landmarks(self, keys: Trajectory, rig: Rig, seen: tuple[NDArray, NDArray, NDArray, NDArray]) -> Landmarks:
        """Returns the landmarks that the method itself located at some time; it never trusted the other tracks."""
        if not len(keys):
            return Landmarks.empty()
        baseline_m = rig.baseline_m if keys.frame == "left" else 0.0
        ids, xyz = intersected(keys, rig.camera(keys.frame), *seen, baseline_m)
        known, rgb = _latest(self._colours)
        trusted = np.isin(ids, known)
        return Landmarks(ids[trusted], xyz[trusted], rgb[np.searchsorted(known, ids[trusted])])

    def _add_colours(self, ids: NDArray[np.int64], rgb: NDArray[np.uint8]) -> None:
        self._colours.append((ids, rgb))
        if sum(len(ids) for ids, _ in self._colours[1:]) > 10_000 + len(self._colours[0][0]):
            self._colours = [_latest(self._colours)]


def _latest(found: list[_Colours]) -> _Colours:
    """Returns each point once, in the order of ids, with its latest colour."""
    ids = np.concatenate([np.zeros(0, np.int64), *(ids for ids, _ in found)])
    rgb = np.concatenate([np.zeros((0, 3), np.uint8), *(rgb for _, rgb in found)])
    index = len(ids) - 1 - np.unique(ids[::-1], return_index=True)[1]
    return ids[index], rgb[index]


@dataclass
class MapCollectors:
    """The maps of all methods."""

    _methods: dict[str, MapCollector] = field(default_factory=dict)

    def add(self, steps: tuple[Step, ...]) -> None:
        for step in steps:
            self._methods.setdefault(step.method, MapCollector()).add(step)

    def scenes(self, trajectories: Mapping[str, Trajectory], methods: tuple[str, ...], rig: Rig) -> dict[str, SceneMap]:
        return {m: self._methods.get(m, MapCollector()).scene(trajectories[m], rig) for m in methods}
