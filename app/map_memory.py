"""What `ispom run` remembers of the scene: the latest place of every landmark, and what the key frames saw."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.io.maps import CAMERAS, SceneMap
from ispom.types import Frame, Landmarks, Rig, Step, TrackStatus, Trajectory


@dataclass
class MapMemory:
    """Grows with the landmarks and key frames of one method."""

    camera: Frame | None = None
    _xyz: dict[int, Array] = field(default_factory=dict)
    _rgb: dict[int, NDArray[np.uint8]] = field(default_factory=dict)
    _seen: dict[int, tuple[NDArray[np.int64], NDArray[np.float32]]] = field(default_factory=dict)

    def add(self, step: Step) -> None:
        """Landmarks of every step; tracks of key frames, its own or those of the part that follows points."""
        found = step.landmarks
        good = np.isfinite(found.xyz_in_world).all(axis=1)
        ids = found.ids[good].tolist()
        self._xyz.update(zip(ids, found.xyz_in_world[good], strict=True))
        self._rgb.update(zip(ids, found.rgb[good], strict=True))
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
        ids = sorted(self._xyz)
        landmarks = Landmarks.empty()
        if ids:
            rgb = np.array([self._rgb[i] for i in ids], np.uint8)
            landmarks = Landmarks(np.array(ids, np.int64), np.array([self._xyz[i] for i in ids]), rgb)
        seen = [self._seen[t] for t in times]
        return SceneMap(
            landmarks,
            keys.moved(right=rig.rig_from(trajectory.frame).inverse() @ rig.rig_from(camera), frame=camera),
            np.repeat(np.arange(len(times)), [len(i) for i, _ in seen]),
            np.concatenate([np.zeros(0, np.int64), *(i for i, _ in seen)]),
            np.concatenate([np.zeros((0, 2), np.float32), *(uv for _, uv in seen)]),
        )


@dataclass
class MapMemories:
    """Of all methods."""

    _methods: dict[str, MapMemory] = field(default_factory=dict)

    def add(self, steps: tuple[Step, ...]) -> None:
        for step in steps:
            self._methods.setdefault(step.method, MapMemory()).add(step)

    def scenes(self, trajectories: Mapping[str, Trajectory], methods: tuple[str, ...], rig: Rig) -> dict[str, SceneMap]:
        return {m: self._methods.get(m, MapMemory()).scene(trajectories[m], rig) for m in methods}
