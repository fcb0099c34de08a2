"""One method in viser's scene, in blocks: a block is sent again where a pose or point in it changed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import viser

from ispom.geometry import Array, Pose, Similarity
from ispom.types import Camera

from ...engine.events import Opened
from ...engine.model.drawn_size import DrawnSize, drawn_size
from ...engine.model.placing import same_place
from ...engine.model.points import PointMap
from ...engine.model.poses import PoseHistory, Times
from ...engine.model.run_model import MethodModel
from ...presentation import colours
from ...presentation.uncertainty import ellipsoid

MAX_CLOUD = 20_000
"""Points per method: the Rerun viewer beside it has them all."""
OCTAHEDRON = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float32)
OCTAHEDRON_FACES = np.array(
    [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]], np.uint32
)
CAMERA, KEY_FRAME, POINT = 2.0, 0.6, 0.08
"""Sizes of frustum, marker and point, relative to what is drawn in Rerun: this scene is smaller on the page."""
SHADOWLESS: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}


class MethodScene:
    """What is drawn of one method. Nodes are below `/METHOD`, or another `root`, in the shared world."""

    def __init__(
        self,
        api: viser.SceneApi,
        method: str,
        opened: Opened,
        seek: Callable[[int], None],
        root: str = "",
    ) -> None:
        self._api, self._method, self._root, self._seek = api, method, root or f"/{method}", seek
        self._colour, self._rig, self._truth = colours.of(method), opened.sequence.rig, opened.truth
        self._frame = api.add_frame(self._root, show_axes=False)
        self._view = next(c for c in (self._rig.video, self._rig.left, Camera(4, 3, 4, 4, 2, 1.5)) if c is not None)
        self._placement = Similarity()
        self._size = DrawnSize(1.0, 1.0, 0.0)
        self._drawn: dict[str, tuple[Any, ...]] = {}
        """By node: the values that it was drawn from."""
        self._camera: viser.CameraFrustumHandle | None = None
        self._index = 0

    def show(self, times: Times, known: MethodModel, placement: Similarity, index: int, hidden: frozenset[str]) -> None:
        """What is known at exposure `index`, placed in the shared world."""
        self._index = index
        self.visible(self._method not in hidden)
        moved = not same_place(placement, self._placement)
        before = self._size
        self._placement = placement
        self._size = drawn_size(
            self._method, self._rig, self._truth, known.poses, placement.scale, None if moved else before
        )
        if moved or self._size is not before:
            self._drawn = dict.fromkeys(self._drawn, ())
        nodes = self._path(known.poses)
        if "key_frames" not in hidden:
            nodes |= self._key_frames(known.poses, times)
        if "clouds" not in hidden:
            nodes |= self._cloud(known.points)
        for name in self._drawn.keys() - nodes.keys():
            self._api.remove_by_name(name)
            del self._drawn[name]
        self._pose(known, hidden)

    def mark(self, *, provisional: bool) -> None:
        """Draws the camera as one whose pose waits for a first fit, or as usual."""
        colour = colours.PROVISIONAL if provisional else self._colour
        if self._camera is not None and tuple(self._camera.color) != colour:
            self._camera.color = colour

    def visible(self, on: bool) -> None:
        """Whether any of it is seen."""
        if self._frame.visible != on:
            self._frame.visible = on

    def remove(self) -> None:
        self._frame.remove()

    def _once(self, name: str, draw: Callable[[str], object], *values: object) -> dict[str, None]:
        """Draws a node, where it was drawn from other values before."""
        before = self._drawn.get(name)
        if before is None or len(before) != len(values) or any(a is not b for a, b in zip(before, values, strict=True)):
            draw(name)
            self._drawn[name] = values
        return {name: None}

    def _path(self, poses: PoseHistory) -> dict[str, None]:
        nodes: dict[str, None] = {}
        for b in sorted(poses.drawn_blocks()):

            def draw(name: str, b: int = b) -> None:
                add_lines(self._api, name, [self._placement.apply(xyz) for xyz in poses.lines(b)], self._colour)

            nodes |= self._once(f"{self._root}/path/{b}", draw, poses.blocks[b], poses.blocks[b - 1] if b else None)
        return nodes

    def _key_frames(self, poses: PoseHistory, times: Times) -> dict[str, None]:
        nodes: dict[str, None] = {}
        for b in sorted(poses.drawn_blocks()):
            rows = poses.key_frame_rows(b)
            if len(rows):

                def draw(name: str, rows=rows) -> None:
                    places = self._placement.apply(np.stack([poses.position(int(row)) for row in rows]))
                    self._draw_key_frames(name, places, times.indices(rows).tolist())

                nodes |= self._once(f"{self._root}/key_frames/{b}", draw, poses.blocks[b])
        return nodes

    def _draw_key_frames(self, name: str, places: Array, indices: list[int]) -> None:
        handle = self._api.add_batched_meshes_simple(
            name,
            OCTAHEDRON * (KEY_FRAME * self._placement.scale * self._size.key_frame),
            OCTAHEDRON_FACES,
            batched_wxyzs=np.tile(np.array([1, 0, 0, 0], np.float32), (len(places), 1)),
            batched_positions=places.astype(np.float32),
            batched_colors=colours.shade(self._colour, (0, 0, 0), 0.5),  # viser's lights brighten it again
            flat_shading=True,
            lod="off",
            **SHADOWLESS,
        )

        @handle.on_click
        def _(event: Any) -> None:
            if event.instance_index is not None:
                self._seek(indices[event.instance_index])

    def _cloud(self, points: PointMap) -> dict[str, None]:
        every = 1 << max(0, (points.count - 1) // MAX_CLOUD).bit_length()
        nodes: dict[str, None] = {}
        for b, block in enumerate(points.blocks):

            def draw(name: str, block=block) -> None:
                places = self._placement.apply(block.xyz[::every].astype(float)).astype(np.float32)
                style = {
                    "point_size": POINT * self._placement.scale * self._size.camera,
                    "point_shape": "circle",
                    "precision": "float32",
                }
                self._api.add_point_cloud(name, places, block.rgb[::every], **style)  # type: ignore[arg-type]

            nodes |= self._once(f"{self._root}/cloud/{every}/{b}", draw, block)
        return nodes

    def _pose(self, known: MethodModel, hidden: frozenset[str]) -> None:
        """The camera, and how well its place is known."""
        row = known.poses.last_known()
        if row is None:
            if self._camera is not None:
                self._camera.visible = False
            self._draw_uncertainty(None, None)
            return
        own = known.poses.pose(row)
        self._draw_camera(self._placement.apply_pose(own), "cameras" not in hidden)
        self._draw_uncertainty(own, None if "uncertainty" in hidden else known.covariance)

    def _draw_camera(self, pose: Pose, visible: bool) -> None:
        if self._camera is None:
            self._camera = self._api.add_camera_frustum(
                f"{self._root}/camera",
                2 * float(np.arctan(self._view.height / 2 / self._view.fy)),
                self._view.width / self._view.height,
                thickness=2.0,
                thickness_units="screen",
                color=self._colour,
            )
            self._camera.on_click(lambda _: self._seek(self._index))
        self._camera.wxyz, self._camera.position = pose.xyzw[[3, 0, 1, 2]], pose.translation
        self._camera.scale = CAMERA * self._placement.scale * self._size.camera
        self._camera.visible = visible

    def _draw_uncertainty(self, pose: Pose | None, covariance: Array | None) -> None:
        found = ellipsoid(pose, covariance) if pose is not None and covariance is not None else None
        if found is None:
            self._api.remove_by_name(f"{self._root}/uncertainty")
            return
        placed = self._placement.apply_pose(found.pose)
        self._api.add_icosphere(
            f"{self._root}/uncertainty",
            color=self._colour,
            subdivisions=2,
            opacity=0.4,
            scale=tuple((self._placement.scale * found.half_sizes).tolist()),
            wxyz=placed.xyzw[[3, 0, 1, 2]],
            position=placed.translation,
            **SHADOWLESS,
        )


def add_line(api: viser.SceneApi, name: str, xyz: Array, colour: colours.Rgb, width_px: float = 2.5) -> None:
    """One line through (K, 3)."""
    add_lines(api, name, [xyz], colour, width_px)


def add_lines(api: viser.SceneApi, name: str, places: list[Array], colour: colours.Rgb, width_px: float = 2.5) -> None:
    """Lines through (K, 3) each."""
    places = [np.repeat(xyz, 2, axis=0) if len(xyz) == 1 else xyz for xyz in places]
    pairs = np.concatenate([np.stack([xyz[:-1], xyz[1:]], axis=1) for xyz in places]).astype(np.float32)
    api.add_line_segments(name, pairs, colour, thickness=width_px, thickness_units="screen")
