"""What `ispom run` remembers of the scene: the latest place of every landmark, and what the key frames saw."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ispom.io.maps import CAMERAS, SceneMap
from ispom.types import Frame, Landmarks, Rig, Step, TrackStatus, Trajectory


@dataclass
class MapCollector:
    """Grows with the landmarks and key frames of one method, by some 40 bytes for each point seen."""

    camera: Frame | None = None
    _found: list[Landmarks] = field(default_factory=list)
    _seen: dict[int, tuple[NDArray[np.int64], NDArray[np.float32]]] = field(default_factory=dict)

    def add(self, step: Step) -> None:
        """Landmarks of every step; tracks of key frames, its own or those of the part that follows points."""
        found = step.landmarks
        good = np.isfinite(found.xyz_in_world).all(axis=1)
        if good.any():
            self._found.append(Landmarks(found.ids[good], found.xyz_in_world[good], found.rgb[good]))
        part = next((p for p in step.parts if p.method == "monocular"), None) if step.parts else step
        if part is None or not part.key_frame:
            return
        for name in CAMERAS:
            if name in part.tracks:
                tracks = part.tracks[name]
                alive = tracks.status < TrackStatus.LOST
                self.camera = name
                self._seen[step.time_ns] = tracks.ids[alive], tracks.uv[alive]

    def scene(self, trajectory: Trajectory, rig: Rig) -> SceneMap:
        """With the final poses of the key frames; those that have none in the trajectory are left out."""
        camera = self.camera or ("video" if rig.video is not None else "left")
        times = [t for t in trajectory.times_ns.tolist() if t in self._seen]
        keys = trajectory.select(np.isin(trajectory.times_ns, np.array(times, np.int64)))
        seen = [self._seen[t] for t in times]
        return SceneMap(
            _latest(self._found),
            keys.moved(right=rig.rig_from(trajectory.frame).inverse() @ rig.rig_from(camera), frame=camera),
            np.repeat(np.arange(len(times)), [len(i) for i, _ in seen]),
            np.concatenate([np.zeros(0, np.int64), *(i for i, _ in seen)]),
            np.concatenate([np.zeros((0, 2), np.float32), *(uv for _, uv in seen)]),
        )


def _latest(found: list[Landmarks]) -> Landmarks:
    """Each point once, in the order of ids, as it was found last."""
    parts = [Landmarks.empty(), *found]
    ids = np.concatenate([part.ids for part in parts])
    index = len(ids) - 1 - np.unique(ids[::-1], return_index=True)[1]
    xyz, rgb = np.concatenate([p.xyz_in_world for p in parts]), np.concatenate([p.rgb for p in parts])
    return Landmarks(ids[index], xyz[index], rgb[index])


@dataclass
class MapCollectors:
    """Of all methods."""

    _methods: dict[str, MapCollector] = field(default_factory=dict)

    def add(self, steps: tuple[Step, ...]) -> None:
        for step in steps:
            self._methods.setdefault(step.method, MapCollector()).add(step)

    def scenes(self, trajectories: Mapping[str, Trajectory], methods: tuple[str, ...], rig: Rig) -> dict[str, SceneMap]:
        return {m: self._methods.get(m, MapCollector()).scene(trajectories[m], rig) for m in methods}
