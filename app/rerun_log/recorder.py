"""Events of a run -> what Rerun shall show. No stream is touched here: see streams.py.

Entities, below the shared world (the rig at the first stereo exposure: x right, y down, z forward):

    /world/truth/{path,rig}                  the whole true path (static); the true pose now
    /world/METHOD                            shared world from the method's own (the monocular one has its own unit)
    /world/METHOD/{path,key_frames,cloud}/N  in blocks; a block is logged again when a pose or point in it changed
    /world/METHOD/camera                     the pose now
    /world/METHOD/spread                     what holds its position with 95 %, where the method tells a covariance
    /world/METHOD/final                      at the end: the final poses, each at its exposure; path/final is their line
    /video, /left                            image, tracks, trails, legend; left also disparity
    /plots/{error,scale,inliers,residual,ms}/METHOD...
    /decisions, /log                         text

Timelines: `exposure` (its index) and `time` (since the first exposure).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import rerun as rr

from ispom.geometry import Array, Pose, Similarity
from ispom.methods import method as registered
from ispom.types import Frame, Step, StereoPair, Tracks, Trajectory

from .. import colours, uncertainty
from ..run.events import Event, Finished, Opened, Stepped
from . import entities
from .memory import Cloud, PoseHistory

TINT = 0.3
"""How much of a cloud's colour is its method's, the rest being what the camera saw."""


@dataclass(frozen=True, eq=False)
class Entry:
    """One value of one entity."""

    path: str
    value: rr.AsComponents
    static: bool = False


@dataclass(frozen=True, eq=False)
class Columns:
    """A whole final trajectory: world_from_frame at many exposures."""

    path: str
    trajectory: Trajectory
    indices: np.ndarray
    """(N,) of its exposures in the sequence."""
    first_ns: int


@dataclass(frozen=True, eq=False)
class Batch:
    """What one event adds, at one instant of both timelines."""

    index: int
    since_start_ns: int
    entries: tuple[Entry | Columns, ...]


class Recorder:
    """Turns the events of one run into batches. It remembers trajectories and clouds, no images."""

    def __init__(self, opened: Opened) -> None:
        self.opened = opened
        self.recording_id = opened.recording_id
        self.first_ns = int(opened.sequence.times_ns[0]) if len(opened.sequence) else 0
        self._paths = {m: PoseHistory(opened.sequence.times_ns) for m in opened.methods}
        self._clouds = {m: Cloud() for m in opened.methods}
        self._placements: dict[str, Similarity] = {}
        self._recent: dict[str, list[Tracks]] = {}
        self._last: dict[str, Step] = {}
        self._spreads: set[str] = set()
        """Methods whose ellipsoid is drawn now."""
        self._drifts: set[str] = set()
        """Methods that tell how far their unit may have drifted."""
        self._now = (0, 0)
        self._stages: dict[str, list[str]] = {m: [] for m in opened.methods}

    def opening(self) -> Batch:
        """What holds for the whole run (all static)."""
        return Batch(0, 0, tuple(self._opening()))

    def batch(self, event: Event) -> Batch:
        """What this event adds. Each event once, in their order."""
        return self._stepped(event) if isinstance(event, Stepped) else self._finished(event)

    def _stepped(self, event: Stepped) -> Batch:
        self._now = (event.index, event.exposure.time_ns - self.first_ns)
        for path in self._paths.values():
            path.know(event.index, event.exposure.time_ns)
        entries = [*self._place(event.placements), *self._truth_now(event), *self._images(event)]
        for step in event.steps:
            entries += self._pose(step, event)
            entries += self._plots(step, event)
            entries += self._log(step)
            self._last[step.method] = step
        entries.append(Entry("decisions", rr.TextDocument(self._summary(), media_type="text/markdown")))
        return Batch(*self._now, tuple(entries))

    def _finished(self, event: Finished) -> Batch:
        entries: list[Entry | Columns] = [*self._place(event.placements)]
        for method, trajectory in event.trajectories.items():
            if len(trajectory):
                path = self._paths[method]
                line = _lines([trajectory.translations], colours.of(method), 2.0)
                entries += self._path_blocks(method, path.update(trajectory))
                entries += self._cloud_blocks(method, self._clouds[method].changed())
                entries.append(Entry(f"world/{method}/path/final", line))
                entries.append(
                    Columns(f"world/{method}/final", trajectory, path.indices(trajectory.times_ns), self.first_ns)
                )
        return Batch(*self._now, tuple(entries))

    def _opening(self) -> Iterator[Entry]:
        yield Entry("world", rr.ViewCoordinates.RDF, static=True)
        for camera in ("video", "left"):
            yield Entry(camera, entities.statuses(), static=True)
        truth = self.opened.truth
        if truth is not None:
            yield Entry("world/truth/path", _lines([truth.translations], colours.TRUTH, 1.0), static=True)
            yield Entry(
                "world/truth/rig", self._frusta("rig", self._size, colours.TRUTH, main_camera=True), static=True
            )
        for method in self.opened.methods:
            for kind in ("error", "inliers", "residual"):
                yield Entry(f"plots/{kind}/{method}", _series(_name(method), colours.of(method)), static=True)
            scale = registered(method).scale
            for kind, name, pale in (
                ("transferred", scale, 0.5),
                ("of_truth", "step / true step", 0.0),
            ):
                colour = colours.shade(colours.of(method), (128, 128, 128), pale)
                yield Entry(f"plots/scale/{method}/{kind}", _series(f"{_name(method)}: {name}", colour), static=True)

    def _place(self, placements: Mapping[str, Similarity]) -> Iterator[Entry]:
        for method, new in placements.items():
            if method in self._paths and not _same(self._placements.get(method), new):
                self._placements[method] = new
                yield Entry(f"world/{method}", entities.placement(new))
                if self._paths[method].drawn_frame:
                    yield from self._camera(method)
                yield from self._path_blocks(method, self._paths[method].all_blocks())

    def _truth_now(self, event: Stepped) -> Iterator[Entry]:
        pose = self.opened.truth.at(event.exposure.time_ns) if self.opened.truth is not None else None
        if pose is not None:
            yield Entry("world/truth/rig", entities.transform(pose))

    def _images(self, event: Stepped) -> Iterator[Entry]:
        exposure = event.exposure
        name, image = ("left", exposure.left) if isinstance(exposure, StereoPair) else ("video", exposure.image)
        if not image.size:  # given up on the way here: see live.Mailbox
            return
        yield Entry(f"{name}/image", entities.jpeg(image))
        tracks = next((s.tracks[name] for s in _with_parts(event.steps) if name in s.tracks), None)
        if tracks is None:
            return
        camera = self.opened.sequence.rig.camera(name)
        recent = self._recent[name] = [*self._recent.get(name, []), tracks][-entities.TRAIL_LENGTH - 1 :]
        yield Entry(f"{name}/tracks", entities.points(tracks, camera))
        yield Entry(f"{name}/trails", entities.trails(recent, camera))
        yield Entry(f"{name}/legend", entities.legend(tracks, camera))
        if name == "left":
            yield Entry(f"{name}/disparity", entities.disparities(tracks, camera))

    def _pose(self, step: Step, event: Stepped) -> Iterator[Entry]:
        method, path, cloud = step.method, self._paths[step.method], self._clouds[step.method]
        changed = path.update(step.revised)
        if step.world_from_frame is not None:
            changed |= path.update(_single(step.time_ns, step.world_from_frame, step.frame))
        if step.key_frame:
            changed |= path.mark(step.time_ns)
        yield from self._path_blocks(method, changed)
        if step.world_from_frame is not None:
            yield Entry(f"world/{method}/camera", entities.transform(step.world_from_frame))
            if path.drawn_frame != path.frame:
                path.drawn_frame = path.frame
                yield from self._camera(method)
        elif path.drawn_frame:  # a camera left standing would look like a pose
            path.drawn_frame = None
            yield Entry(f"world/{method}/camera", rr.Clear(recursive=False))
        yield from self._spread(step)
        cloud.update(step.landmarks)
        if step.key_frame:
            yield from self._cloud_blocks(method, cloud.changed())

    def _spread(self, step: Step) -> Iterator[Entry]:
        found, place = uncertainty.of_step(step), f"world/{step.method}/spread"
        if found is not None:
            yield Entry(place, entities.ellipsoid(found, colours.of(step.method)))
        elif step.method in self._spreads:
            yield Entry(place, rr.Clear(recursive=False))
        (self._spreads.discard if found is None else self._spreads.add)(step.method)

    def _camera(self, method: str) -> Iterator[Entry]:
        frame, colour = self._paths[method].frame, colours.of(method)
        yield Entry(
            f"world/{method}/camera",
            self._frusta(frame, self._own_size(method), colour, "video" in registered(method).needs),
        )

    def _path_blocks(self, method: str, blocks: set[int]) -> Iterator[Entry]:
        path, colour = self._paths[method], colours.of(method)
        outlines = self._outlines(path.frame, 0.5 * self._own_size(method), main_camera=True)
        for block in sorted(blocks):
            yield Entry(f"world/{method}/path/{block}", _lines([path.line(block)], colour, 1.5))
            keys = path.key_frames(block, outlines)
            if len(keys):
                yield Entry(f"world/{method}/key_frames/{block}", _lines(keys, colour, 0.5))

    def _cloud_blocks(self, method: str, blocks: set[int]) -> Iterator[Entry]:
        for block in sorted(blocks):
            xyz, rgb = self._clouds[method].points(block)
            tinted = (1 - TINT) * rgb + TINT * np.array(colours.of(method))
            yield Entry(f"world/{method}/cloud/{block}", rr.Points3D(xyz, colors=tinted.astype(np.uint8), radii=[-1.5]))

    def _plots(self, step: Step, event: Stepped) -> Iterator[Entry]:
        method = step.method
        if method in event.errors_m:
            yield Entry(f"plots/error/{method}", rr.Scalars(event.errors_m[method]))
            ratio = self._step_of_truth(step)
            if ratio is not None:
                yield Entry(f"plots/scale/{method}/of_truth", rr.Scalars(ratio))
        if step.scale is not None:
            yield Entry(f"plots/scale/{method}/transferred", rr.Scalars(step.scale))
        if step.scale_sigma is not None:
            if method not in self._drifts:
                self._drifts.add(method)
                yield Entry(f"plots/scale/{method}/drift", _drift_series(method), static=True)
            band = np.exp(step.scale_sigma * np.array([1.0, -1.0]))
            yield Entry(f"plots/scale/{method}/drift", rr.Scalars(band))
        if len(step.residuals_px):
            yield Entry(f"plots/inliers/{method}", rr.Scalars(len(step.residuals_px)))
            yield Entry(f"plots/residual/{method}", rr.Scalars(float(np.median(step.residuals_px))))
        yield from self._times(method, step.seconds)

    def _times(self, method: str, seconds: Mapping[str, float]) -> Iterator[Entry]:
        stages = self._stages[method]
        new = [stage for stage in seconds if stage not in stages]
        if new:
            stages += new
            yield Entry(f"plots/ms/{method}", _stage_series(method, stages), static=True)
        if seconds:
            values = [sum(seconds.values()), *(seconds.get(stage, np.nan) for stage in stages)]
            yield Entry(f"plots/ms/{method}", rr.Scalars(1e3 * np.array(values)))

    def _log(self, step: Step) -> Iterator[Entry]:
        before = self._last.get(step.method)
        if before is None or before.status != step.status:
            level = "WARN" if step.status == "lost" else "INFO"
            yield Entry("log", rr.TextLog(f"{step.method}: {step.status}", level=level))
        if step.key_frame:
            yield Entry("log", rr.TextLog(f"{step.method}: key frame", level="DEBUG"))

    def _summary(self) -> str:
        steps = {m: self._last[m] for m in self.opened.methods if m in self._last}
        return entities.summary(steps, self.first_ns, {m: placed.scale for m, placed in self._placements.items()})

    @cached_property
    def _size(self) -> float:
        """Depth of the current camera's frustum [m]: to the path's measure, where there is a true one."""
        return float(np.clip(0.012 * self.opened.truth.length, 0.3, 6.0)) if self.opened.truth is not None else 0.5

    def _own_size(self, method: str) -> float:
        """The same in the method's own unit."""
        return self._size / self._placements.get(method, Similarity()).scale

    @cache  # noqa: B019 - a recorder lives as long as its run, and asks for a handful
    def _outlines(self, frame: Frame, size: float, main_camera: bool) -> Array:
        """Frusta (L, P, 3) in a frame: of the video camera (without one: the left), or of both stereo ones."""
        rig = self.opened.sequence.rig
        main: Frame = "video" if rig.video is not None else "left"
        names: tuple[Frame, ...] = (main,) if main_camera or not rig.has_stereo else ("left", "right")
        frame_from_rig = rig.rig_from(frame).inverse()
        return np.stack([entities.frustum(rig.camera(n), frame_from_rig @ rig.rig_from(n), size) for n in names])

    def _frusta(self, frame: Frame, size: float, colour: colours.Rgb, main_camera: bool) -> rr.LineStrips3D:
        return _lines(self._outlines(frame, size, main_camera), colour, 1.5)

    def _step_of_truth(self, step: Step) -> float | None:
        """Distance covered in the last second over the true one."""
        placement = self._placements.get(step.method, Similarity())
        earlier = self._paths[step.method].second_before(step.time_ns)
        truth, rig = self.opened.truth, self.opened.sequence.rig
        if earlier is None or truth is None or step.world_from_frame is None:
            return None
        before, after = truth.at(earlier[0]), truth.at(step.time_ns)
        if before is None or after is None:
            return None
        lever = rig.rig_from(step.frame).translation
        true = float(np.linalg.norm(after.apply(lever) - before.apply(lever)))
        estimated = placement.scale * float(np.linalg.norm(step.world_from_frame.translation - earlier[1]))
        return estimated / true if true > 0.05 else None


def _name(method: str) -> str:
    """As people read it."""
    return method.replace("_", " ")


def _with_parts(steps: tuple[Step, ...]) -> Iterator[Step]:
    for step in steps:
        yield step
        yield from _with_parts(step.parts)


def _single(time_ns: int, pose: Pose, frame: Frame) -> Trajectory:
    return Trajectory(np.array([time_ns]), pose.rotation[None], pose.translation[None], frame)


def _lines(strips: list[Array] | Array, colour: colours.Rgb, width_px: float) -> rr.LineStrips3D:
    """Negative radii are screen units in Rerun."""
    drawn = entities.strips(np.asarray(strips, np.float32))
    return rr.LineStrips3D(drawn, colors=colours.packed(colour), radii=[-width_px])


def _stage_series(method: str, stages: list[str]) -> rr.SeriesLines:
    """The total in the method's colour, its stages in paler and paler ones."""
    fractions = [0.0, *(0.3 + 0.5 * i / len(stages) for i in range(len(stages)))]
    return rr.SeriesLines(
        names=[_name(method), *(f"{_name(method)}: {stage}" for stage in stages)],
        colors=[colours.shade(colours.of(method), (160, 160, 160), f) for f in fractions],
        widths=[2.5, *[1.0] * len(stages)],
    )


def _drift_series(method: str) -> rr.SeriesLines:
    """What the unit may have become since the start, one standard deviation up and down."""
    colour = colours.shade(colours.of(method), (128, 128, 128), 0.7)
    names = [f"{_name(method)}: unit since the start, {side} sigma" for side in ("plus a", "minus a")]
    return rr.SeriesLines(names=names, colors=[colour, colour], widths=[1.0, 1.0])


def _series(name: str, colour: colours.Rgb, width: float = 1.5) -> rr.SeriesLines:
    return rr.SeriesLines(names=name, colors=colour, widths=width)


def _same(a: Similarity | None, b: Similarity) -> bool:
    return a is not None and a.scale == b.scale and np.array_equal(a.pose.matrix, b.pose.matrix)
