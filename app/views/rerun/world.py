"""The 3-D part of a recording, below /world: poses and their uncertainty, paths, keyframes, and point clouds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
import rerun as rr

from ispom.geometry import Array, Pose, Similarity
from ispom.methods import method as registered
from ispom.types import FrameName, Image, Step, Trajectory

from ...engine.events import Finished, Opened, Stepped
from ...engine.model.drawn_size import DrawnSize, drawn_size, drawn_truth, true_size
from ...engine.model.placing import same_place
from ...engine.model.points import PointMap
from ...engine.model.poses import PoseHistory
from ...engine.model.run_model import RunModel
from ...engine.model.true_path import TruePath
from ...presentation import colours, uncertainty
from . import entities
from .batch import Columns, Entry
from .external_trajectories import ExternalTrajectoryLog

MAP_EVERY = 10
"""Number of frames after which a method's keyframes and points are drawn again. They take most of a viewer's memory."""
PATH_PX, POINT_PX, ERROR_PX, CAMERA_PX, KEY_FRAME_PX = 1.0, 1.25, 1.25, 0.6, 0.3
"""Half widths on the screen; a path is wider than the cameras on it."""


class World:
    """Draws one run. Only blocks of paths, keyframes and clouds that changed are drawn again."""

    def __init__(self, opened: Opened, first_ns: int) -> None:
        self._opened, self._first_ns = opened, first_ns
        self._truth = drawn_truth(opened.truth, opened.methods)
        self._true_path, self._truth_placed = TruePath(opened), None
        self.model = RunModel.start(opened.methods)
        self.placements: dict[str, Similarity] = {}
        self._sizes: dict[str, DrawnSize] = {}
        self._drawn_frames: dict[str, FrameName] = {}
        """By method: the frame of the cameras that are drawn now."""
        self._drawn_points = {m: PointMap() for m in opened.methods}
        self._drawn_keys: dict[str, PoseHistory] = {}
        """Poses that the keyframes were drawn from."""
        self._map_drawn: dict[str, int] = {}
        """Frame at which keyframes and points were drawn last."""
        self._provisional: set[str] = set()
        """Methods whose pose now is drawn as one that is not metric yet."""
        self._ellipsoids: set[str] = set()
        """Methods whose ellipsoid is drawn now."""
        self._lined: set[str] = set()
        """Methods whose lines are drawn now."""
        self._frustum_lines: dict[tuple[FrameName, float, bool], Array] = {}
        """Cache of a few outlines. `functools.cache` would keep references to every run that was ever drawn."""
        self._external_log = ExternalTrajectoryLog(opened)
        self._errors: set[str] = set()
        """Methods whose error is drawn now."""
        rig = opened.sequence.rig
        self._viewing: tuple[str, FrameName] | None = None
        """The method in whose frustum an image is drawn, and the camera of the image: the method that uses most
        cameras."""
        self._view_pose: Pose | None = None
        """Pose of that camera in its latest frame, in the method's world; None without one."""
        if opened.methods and (rig.video or rig.left) is not None:
            most = max(opened.methods, key=lambda m: len(registered(m).sensors))
            self._viewing = most, "video" if rig.video is not None else "left"

    def opening(self) -> Iterator[Entry]:
        """What holds for the whole run (all static)."""
        yield Entry("world", rr.ViewCoordinates.RDF, static=True)
        truth = self._truth
        if truth is not None:
            yield Entry("world/truth/path", entities.lines([truth.translations], colours.TRUTH, 0.75), static=True)
            yield Entry("world/truth/rig", self._true_frusta(truth), static=True)
            yield Entry("world/truth/name", _name_of_truth(truth), static=True)
        yield from self._external_log.opening()

    def stepped(self, event: Stepped) -> Iterator[Entry]:
        """Each event once, in their order."""
        before = self.model
        yield from self._place(event.placements)
        yield from self._truth_now(event.exposure.time_ns)
        self.model = before.after(event.index, event.exposure.time_ns, event.steps)
        for step in event.steps:
            resized = step.key_frame and self._resized(step.method)
            poses = self.model.methods[step.method].poses
            changed = poses.drawn_blocks() if resized else self._changed(step.method, before)
            yield from self._path_blocks(step.method, changed)
            yield from self._pose(step, resized)
            yield from self._uncertainty(step)
            yield from self._lines(step)
            due = event.index - self._map_drawn.get(step.method, -MAP_EVERY) >= MAP_EVERY
            if (step.key_frame and due) or resized:
                self._map_drawn[step.method] = event.index
                yield from self._map(step.method, resized)
        outlines = self._outlines("rig", true_size(self._truth) or 1.0, main_camera=True)
        time_ns = event.exposure.time_ns
        yield from self._external_log.at(event.index, time_ns, self.model, self.placements, outlines)
        yield from self._external_log.errors(event.index)
        if not self._true_path.fixed:
            yield from self._place_truth(event.exposure.time_ns)
        for step in event.steps:
            yield from self._error(step)
        yield from self._view(event)

    def picture(self, camera: FrameName, image: Image, steps: Iterable[Step]) -> Iterator[Entry]:
        """Yields the image in the frustum, if it is of this camera and has a pose."""
        posed = (s.method for s in steps if s.world_from_frame is not None)
        if self._viewing is not None and self._viewing[1] == camera and self._viewing[0] in posed:
            yield Entry(f"world/view/{self._viewing[0]}/{camera}", entities.thumbnail(image))

    def finished(self, event: Finished) -> Iterator[Entry | Columns]:
        yield from self._place(event.placements)
        before, found = self.model, {m: t for m, t in event.trajectories.items() if len(t)}
        self.model = before.with_final(found)
        times = self.model.times
        for method, trajectory in found.items():
            yield from self._path_blocks(method, self._changed(method, before))
            yield from self._map(method)
            starts = times.times_ns(np.array(self.model.methods[method].poses.starts, np.int64))
            parts = np.split(trajectory.translations, np.searchsorted(trajectory.times_ns, np.sort(starts)))
            line = entities.lines([part for part in parts if len(part)], colours.of(method), PATH_PX)
            yield Entry(f"world/{method}/path/final", line)
            indices = times.indices(times.rows(trajectory.times_ns))
            yield Columns(f"world/{method}/final", trajectory, indices, self._first_ns)
        if not self._true_path.fixed:
            yield from self._place_truth(None)

    def _changed(self, method: str, before: RunModel) -> set[int]:
        return self.model.methods[method].poses.changed_blocks(before.methods[method].poses)

    def _place(self, placements: Mapping[str, Similarity]) -> Iterator[Entry]:
        for method, new in placements.items():
            if method in self.model.methods and not same_place(self.placements.get(method), new):
                self.placements[method] = new
                self._resized(method, redraw=True)
                yield Entry(f"world/{method}", entities.placement(new))
                if method in self._drawn_frames:
                    yield self._camera(method)
                yield from self._path_blocks(method, self.model.methods[method].poses.drawn_blocks())
                yield from self._map(method, redraw=True)

    def _true_frusta(self, truth: Trajectory) -> rr.LineStrips3D:
        return self._frusta("rig", true_size(truth) or 1.0, colours.TRUTH, main_camera=True)

    def _place_truth(self, time_ns: int | None) -> Iterator[Entry]:
        """Yields the placement of the true path. For a single camera it is aligned by Sim(3) with the poses so far; at
        the end (None) with all of them."""
        truth, before = self._opened.truth, self._truth_placed
        found = self._true_path.at(self.model, self.placements, ended=time_ns is None)
        if truth is None or found is None:
            return
        if before is None:
            yield Entry("world/truth/path", entities.lines([truth.translations], colours.TRUTH, 0.75))
            yield Entry("world/truth/rig", self._true_frusta(truth))
            yield Entry("world/truth/name", _name_of_truth(truth))
        if found is not before:
            self._truth_placed = found
            yield Entry("world/truth", entities.placement(found))
        pose = truth.at(time_ns) if time_ns is not None else None
        if pose is not None:
            yield Entry("world/truth/rig", entities.transform(pose))

    def _truth_now(self, time_ns: int) -> Iterator[Entry]:
        pose = self._truth.at(time_ns) if self._truth is not None else None
        if pose is not None:
            yield Entry("world/truth/rig", entities.transform(pose))

    def _pose(self, step: Step, resized: bool) -> Iterator[Entry]:
        method, frame = step.method, self.model.methods[step.method].poses.frame
        if step.world_from_frame is not None:
            yield Entry(f"world/{method}/camera", entities.transform(step.world_from_frame))
            yield self._name(method, step.world_from_frame)
            marked = step.provisional != (method in self._provisional)
            (self._provisional.add if step.provisional else self._provisional.discard)(method)
            if resized or marked or self._drawn_frames.get(method) != frame:
                self._drawn_frames[method] = frame
                yield self._camera(method)
        elif self._drawn_frames.pop(method, None):  # a camera that is not removed would look like a pose
            yield Entry(f"world/{method}/camera", rr.Clear(recursive=False))

    def _name(self, method: str, pose: Pose) -> Entry:
        """Returns the method's name, at the end of its path. It stays there when there is no pose."""
        placed = self.placements.get(method, Similarity())
        number = self._opened.methods.index(method)
        side = -number if number % 2 else 1 + number  # 1, -1, 3, -3: two steps between any two
        step = side * placed.scale * self._size(method).camera * entities.NAME_STEP
        place = placed.inverse().apply(placed.apply(pose.translation) + step)
        return Entry(f"world/{method}/name", entities.name(colours.label(method), place, colours.of(method)))

    def _uncertainty(self, step: Step) -> Iterator[Entry]:
        found, place = uncertainty.of_step(step), f"world/{step.method}/uncertainty"
        if found is not None:
            yield Entry(place, entities.ellipsoid(found, colours.of(step.method)))
        elif step.method in self._ellipsoids:
            yield Entry(place, rr.Clear(recursive=False))
        (self._ellipsoids.discard if found is None else self._ellipsoids.add)(step.method)

    def _lines(self, step: Step) -> Iterator[Entry]:
        """Lines of the scene that the method knows now."""
        place = f"world/{step.method}/lines"
        if len(step.world_lines):
            yield Entry(place, entities.world_lines(step.world_lines))
        elif step.method in self._lined:
            yield Entry(place, rr.Clear(recursive=False))
        (self._lined.add if len(step.world_lines) else self._lined.discard)(step.method)

    def _error(self, step: Step) -> Iterator[Entry]:
        """Yields the line from the pose to the true one at its time, in the method's world."""
        method, truth, pose = step.method, self._opened.truth, step.world_from_frame
        placed = Similarity() if self._true_path.fixed else self._truth_placed
        true = truth.at(step.time_ns) if truth is not None and placed is not None else None
        is_drawn = true is not None and pose is not None
        if true is not None and placed is not None and pose is not None:
            end = placed.apply((true @ self._opened.sequence.rig.rig_from(step.frame)).translation)
            own = self.placements.get(method, Similarity()).inverse().apply(end)
            yield Entry(
                f"world/{method}/error", entities.lines([np.stack([pose.translation, own])], colours.ERROR, 1.25)
            )
        elif method in self._errors:
            yield Entry(f"world/{method}/error", rr.Clear(recursive=False))
        (self._errors.add if is_drawn else self._errors.discard)(method)

    def _view(self, event: Stepped) -> Iterator[Entry]:
        """Yields pose and shape of the image in the frustum. They are in the shared world, because Rerun draws no
        pinhole below a change of scale. The pinhole exists from the first frame on, without a size while there is no
        pose, because a viewer that once had a pinhole without values never draws the image again."""
        if self._viewing is None:
            return
        rig, (method, camera) = self._opened.sequence.rig, self._viewing
        if event.exposure.kind == ("stereo" if camera == "left" else "video"):
            step = next((s for s in event.steps if s.method == method), None)
            pose = step.world_from_frame if step is not None else None
            frame = step.frame if step is not None else "rig"
            self._view_pose = pose and pose @ rig.rig_from(frame).inverse() @ rig.rig_from(camera)
        path, placement = f"world/view/{method}", self.placements.get(method, Similarity())
        depth = placement.scale * self._size(method).camera if self._view_pose is not None else 0.0
        yield Entry(path, entities.transform(placement.apply_pose(self._view_pose or Pose())))
        yield Entry(path, entities.pinhole(rig.camera(camera), depth))
        yield Entry(path, rr.TransformAxes3D(axis_length=0.0))

    def _camera(self, method: str) -> Entry:
        frame = self.model.methods[method].poses.frame
        colour = colours.PROVISIONAL if method in self._provisional else colours.of(method)
        main = "video" in registered(method).sensors
        return Entry(f"world/{method}/camera", self._frusta(frame, self._size(method).camera, colour, main))

    def _path_blocks(self, method: str, blocks: set[int]) -> Iterator[Entry]:
        poses, colour = self.model.methods[method].poses, colours.of(method)
        for block in sorted(blocks):
            yield Entry(f"world/{method}/path/{block}", entities.lines(poses.lines(block), colour, PATH_PX))

    def _map(self, method: str, redraw: bool = False) -> Iterator[Entry]:
        """Keyframes and points, the blocks that changed since they were drawn last, or all of the keyframes."""
        poses = self.model.methods[method].poses
        before = PoseHistory() if redraw else self._drawn_keys.get(method, PoseHistory())
        self._drawn_keys[method] = poses
        outlines = self._outlines(poses.frame, self._size(method).key_frame, main_camera=True)
        for block in sorted(poses.changed_blocks(before)):
            keys = poses.key_frames(block, outlines)
            if len(keys):
                yield Entry(
                    f"world/{method}/key_frames/{block}", entities.lines(keys, colours.of(method), KEY_FRAME_PX)
                )
        yield from self._cloud(method)

    def _cloud(self, method: str) -> Iterator[Entry]:
        """The blocks that changed since the last call."""
        points = self.model.methods[method].points
        changed = points.changed_blocks(self._drawn_points[method])
        self._drawn_points[method] = points
        for block in sorted(changed):
            xyz, rgb = points.blocks[block].xyz, points.blocks[block].rgb
            drawn = rr.Points3D(xyz, colors=rgb, radii=[-POINT_PX])
            yield Entry(f"world/{method}/cloud/{block}", drawn)

    def _size(self, method: str) -> DrawnSize:
        if method not in self._sizes:
            self._resized(method, redraw=True)
        return self._sizes[method]

    def _resized(self, method: str, *, redraw: bool = False) -> bool:
        """Returns whether the method's drawn size changed, and stores the new one."""
        before, unit_m = self._sizes.get(method), self.placements.get(method, Similarity()).scale
        rig, poses = self._opened.sequence.rig, self.model.methods[method].poses
        size = drawn_size(method, rig, self._truth, poses, unit_m, None if redraw else before)
        self._sizes[method] = size
        return size is not before

    def _outlines(self, frame: FrameName, size: float, main_camera: bool) -> Array:
        """Frusta (L, P, 3) in a frame: of the video camera (without one: the left), or of both stereo ones."""
        if (key := (frame, size, main_camera)) not in self._frustum_lines:
            self._frustum_lines[key] = entities.outlines(self._opened.sequence.rig, *key)
        return self._frustum_lines[key]

    def _frusta(self, frame: FrameName, size: float, colour: colours.Rgb, main_camera: bool) -> rr.LineStrips3D:
        return entities.lines(self._outlines(frame, size, main_camera), colour, CAMERA_PX)


def _name_of_truth(truth: Trajectory) -> rr.Points3D:
    """At the end of its path, which is drawn whole."""
    return entities.name("ground truth", truth.translations[-1], colours.TRUTH)
