"""viser's own 3-D scene: light, and the one that answers clicks. Paths, the poses now, key frames, a thin cloud."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from ispom.estimators import ALL_METHODS
from ispom.geometry import Array, Pose, Similarity
from ispom.types import Camera, Frame, Rig, Step, Trajectory

from .. import colours
from ..run.record import ExposureRecord
from ..uncertainty import ellipsoid

MAX_CLOUD = 20_000
"""Points per method: the Rerun viewer beside it has them all."""
OCTAHEDRON = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float32)
OCTAHEDRON_FACES = np.array(
    [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]], np.uint32
)


@dataclass(eq=False)
class Track:
    """What one method said so far, in its own world, as the newest revision has it."""

    poses: dict[int, Pose] = field(default_factory=dict)
    """By time_ns."""
    frame: Frame = "rig"
    key_frames: list[tuple[int, int]] = field(default_factory=list)
    """(time_ns, index of the exposure)."""
    clouds: list[tuple[int, Array, NDArray[np.uint8]]] = field(default_factory=list)
    """(time_ns, points (M, 3), colours (M, 3)) of key frames."""
    covariances: dict[int, Array] = field(default_factory=dict)
    """By time_ns, (6, 6), where the method tells one."""

    def take(self, step: Step, index: int) -> None:
        self.frame = step.frame
        self.poses.update(step.revised.items())
        if step.world_from_frame is not None:
            self.poses[step.time_ns] = step.world_from_frame
            if step.covariance is not None:
                self.covariances[step.time_ns] = step.covariance
        if step.key_frame:
            self.key_frames.append((step.time_ns, index))
            if len(step.landmarks):
                self.clouds.append((step.time_ns, step.landmarks.xyz_in_world, step.landmarks.rgb))

    def until(self, time_ns: int) -> list[tuple[int, Pose]]:
        return sorted((t, pose) for t, pose in self.poses.items() if t <= time_ns)


class Scene:
    """Draws the run as of one exposure. It holds only what it took from the history, and what it drew."""

    def __init__(self, api: viser.SceneApi, seek: Callable[[int], None]) -> None:
        self._api, self._seek = api, seek
        self.start(None, None)

    def start(self, rig: Rig | None, truth: Trajectory | None) -> None:
        """Empties the scene for another run."""
        self._api.reset()
        self._api.set_up_direction("-y")
        self._rig, self._taken = rig, 0
        self._shown: tuple[int, int, frozenset[str]] | None = None
        self._tracks: dict[str, Track] = {m: Track() for m in ALL_METHODS}
        self._layers = {name: self._api.add_frame(f"/{name}", show_axes=False) for name in ("truth", *ALL_METHODS)}
        self._size = 0.3
        if truth is not None and len(truth) > 1:
            extent = float(np.linalg.norm(np.ptp(truth.translations, axis=0)))
            self._size = min(max(extent / 60, 0.05), 2.0)
            self._line("/truth", truth.translations, colours.TRUTH)

    def show(self, history: list[ExposureRecord], index: int, hidden: frozenset[str]) -> None:
        """The run as of exposure `index` of its history, without the hidden layers and methods."""
        if index < 0 or self._rig is None or (index, len(history), hidden) == self._shown:
            return
        self._shown = (index, len(history), hidden)
        for record in history[self._taken :]:
            for step in record.steps:
                self._tracks[step.method].take(step, record.index)
        self._taken = len(history)
        for method, track in self._tracks.items():
            if track.poses:
                self._draw(method, track, history[index], hidden, self._rig)
        self._layers["truth"].visible = "truth" not in hidden

    def _draw(self, method: str, track: Track, record: ExposureRecord, hidden: frozenset[str], rig: Rig) -> None:
        colour = colours.METHOD[method]  # type: ignore[index]
        placement = record.placements.get(method, Similarity())
        self._layers[method].visible = method not in hidden
        placed = [(t, placement.apply_pose(pose)) for t, pose in track.until(record.time_ns)]
        if not placed:
            return
        self._line(f"/{method}/path", np.stack([pose.translation for _, pose in placed]), colour)
        self._camera(method, placed[-1][1], colour, rig, record.index, "cameras" not in hidden)
        self._spread(method, track, placement, placed[-1][0], "spread" not in hidden)
        self._key_frames(method, track, dict(placed), colour, "key_frames" not in hidden)
        self._cloud(method, track, placement, record.time_ns, "clouds" not in hidden)

    def _line(self, name: str, xyz: Array, colour: colours.Rgb) -> None:
        if len(xyz) > 1:
            pairs = np.stack([xyz[:-1], xyz[1:]], axis=1).astype(np.float32)
            self._api.add_line_segments(f"{name}/line", pairs, colour, thickness=2.5, thickness_units="screen")

    def _camera(self, method: str, pose: Pose, colour: colours.Rgb, rig: Rig, index: int, visible: bool) -> None:
        camera = next(c for c in (rig.video, rig.left, Camera(4, 3, 4, 4, 2, 1.5)) if c is not None)
        handle = self._api.add_camera_frustum(
            f"/{method}/camera",
            2 * float(np.arctan(camera.height / 2 / camera.fy)),
            camera.width / camera.height,
            scale=2 * self._size,
            thickness=2.0,
            thickness_units="screen",
            color=colour,
            wxyz=pose.xyzw[[3, 0, 1, 2]],
            position=pose.translation,
            visible=visible,
        )
        handle.on_click(lambda _: self._seek(index))

    def _spread(self, method: str, track: Track, placement: Similarity, time_ns: int, visible: bool) -> None:
        covariance = track.covariances.get(time_ns) if visible else None
        found = ellipsoid(track.poses[time_ns], covariance) if covariance is not None else None
        if found is None:
            self._api.remove_by_name(f"/{method}/spread")
            return
        placed = placement.apply_pose(found.pose)
        self._api.add_icosphere(
            f"/{method}/spread",
            color=colours.METHOD[method],
            subdivisions=2,
            opacity=0.4,
            scale=tuple((placement.scale * found.half_sizes).tolist()),
            wxyz=placed.xyzw[[3, 0, 1, 2]],
            position=placed.translation,
            cast_shadow=False,
            receive_shadow=False,
        )

    def _key_frames(
        self, method: str, track: Track, placed: dict[int, Pose], colour: colours.Rgb, visible: bool
    ) -> None:
        found = [(placed[t].translation, index) for t, index in track.key_frames if t in placed]
        if not found:
            return
        handle = self._api.add_batched_meshes_simple(
            f"/{method}/key_frames",
            OCTAHEDRON * (0.35 * self._size),
            OCTAHEDRON_FACES,
            batched_wxyzs=np.tile(np.array([1, 0, 0, 0], np.float32), (len(found), 1)),
            batched_positions=np.stack([xyz for xyz, _ in found]).astype(np.float32),
            batched_colors=colours.shade(colour, (0, 0, 0), 0.5),  # viser's lights brighten it again
            flat_shading=True,
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
            visible=visible,
        )

        @handle.on_click
        def _(event: Any) -> None:
            if event.instance_index is not None:
                self._seek(found[event.instance_index][1])

    def _cloud(self, method: str, track: Track, placement: Similarity, now_ns: int, visible: bool) -> None:
        parts = [(xyz, rgb) for t, xyz, rgb in track.clouds if t <= now_ns]
        if not parts or not visible:
            self._api.remove_by_name(f"/{method}/cloud")
            return
        xyz, rgb = np.concatenate([p for p, _ in parts]), np.concatenate([c for _, c in parts])
        every = len(xyz) // MAX_CLOUD + 1
        self._api.add_point_cloud(
            f"/{method}/cloud",
            placement.apply(xyz[::every]).astype(np.float32),
            rgb[::every],
            point_size=0.06 * self._size,
            point_shape="circle",
            precision="float32",
        )
