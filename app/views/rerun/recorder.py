"""Turns events of a run into entities of Rerun. It uses no stream: see streams.py.

Entities, below the shared world (the rig at the first stereo frame: x right, y down, z forward):

    /world/truth/{path,rig,name}             the whole true path (static); the true pose now. Of a single camera
                                             /world/truth brings them to its path, by Sim(3)
    /world/METHOD                            shared world from the method's own (the monocular one has its own unit)
    /world/METHOD/{path,key_frames,cloud}/N  in blocks; a block is logged again when a pose or point in it
                                             changed (keyframes and clouds: every MAP_EVERY frames)
    /world/METHOD/{camera,name}              the pose now; the method's name at the end of its path
    /world/METHOD/uncertainty                95 % ellipsoid of its position, where the method gives a covariance
    /world/METHOD/final                      at the end: the final poses, each at its frame; path/final is their line
    /world/beside/NAME/{path,rig,name}       trajectory of another program, up to now, and its pose now
    /world/METHOD/depth                      points of the latest stereo pair, while that layer is drawn
    /world/METHOD/error                      line from its position to the true one
    /world/view/METHOD[/CAMERA]              of one method: pose and pinhole of its latest frame of CAMERA; its image
    /video, /left, /right                    image, tracks; without right: moving, trails, legend; left also disparity
    /{video,left}/coloured/{age,residual,depth}  the tracks that live, coloured by these
    /plots/{error,scale,inliers,residual,ms}/METHOD...; /plots/error/beside/NAME
    /plots/error/METHOD, .../sim3, .../aligned  live error; of a single camera's newest pose, the poses so far aligned
                                             by Sim(3); at the end, the whole aligned curve whose RMS is the ATE
    /decisions, /log, /log/bookmarks         text
    /start                                   the first frame's time [ns] (static)

Timelines: `exposure` (its index) and `time` (since the first frame).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import rerun as rr

from ispom.geometry import Similarity
from ispom.types import FrameName, Step, Tracks, images_of, is_stereo, main_image
from ispom.types.measurements import CAMERAS

from ...engine.events import Bookmark, Event, Finished, Opened, Pictured, Stepped
from ...engine.history.record import MethodStatus, with_parts
from ...engine.inspection.sightings import Seen
from ...engine.model.drawn_size import unit_in_metres
from . import entities
from .batch import Batch, Entry
from .coloured import ColouredTracks
from .depth import depth_entries
from .parts import image_root
from .plots import Plots
from .world import World

START, START_NS = "start", "time_ns"
"""Entity and component with the time of the first frame."""


class Recorder:
    """Turns the events of one run into batches. It holds the model of the run, and no images."""

    def __init__(self, opened: Opened, has_depth: Callable[[], bool] = lambda: False) -> None:
        """`has_depth` returns whether the depth of a pair is drawn."""
        self.opened = opened
        self.recording_id = opened.recording_id
        self.first_ns = int(opened.sequence.times_ns[0]) if len(opened.sequence) else 0
        self._world, self._plots = World(opened, self.first_ns), Plots(opened)
        self._has_depth, self._depth_path = has_depth, ""
        self._coloured = ColouredTracks(opened.sequence.rig)
        self._recent: dict[str, list[Tracks]] = {}
        self._moving = set[str]()
        """Cameras in which tracks of moving objects were drawn so far."""
        self._lined = set[str]()
        """Cameras in which lines are drawn now."""
        self._last: dict[str, Step] = {}
        self._words: dict[str, str] = {}
        """By method, the word of its latest step: see MethodStatus."""
        self._now = (0, 0)

    def opening(self) -> Batch:
        """What holds for the whole run (all static)."""
        cameras = dict.fromkeys(("video", "left", "right", *self.opened.sequence.rig.cameras))
        images = [Entry(image_root(camera), entities.statuses(), static=True) for camera in cameras]
        images += self._coloured.opening()
        start = Entry(START, rr.AnyValues(time_ns=self.first_ns), static=True)
        return Batch(0, 0, (start, *self._world.opening(), *images, *self._plots.opening()))

    def batch(self, event: Event | Bookmark) -> Batch:
        """Returns what this event adds. Call it once for each event, in their order; a bookmark comes after its
        frame."""
        if isinstance(event, Bookmark):
            text = rr.TextLog(f"bookmark: {event.note}" if event.note else "bookmark")
            return Batch(event.exposure, event.time_ns - self.first_ns, (Entry("log/bookmarks", text),))
        if isinstance(event, Pictured):
            time_ns = event.exposure.time_ns - self.first_ns
            return Batch(event.index, time_ns, tuple(self._pictured(event)))
        if isinstance(event, Finished):
            found = self._world.finished(event)
            return Batch(*self._now, (*found, *self._plots.finished(event, self._world.model, self.first_ns)))
        self._now = (event.index, event.exposure.time_ns - self.first_ns)
        return Batch(*self._now, tuple(self._stepped(event)))

    def _stepped(self, event: Stepped) -> Iterator[Entry]:
        yield from self._world.stepped(event)
        yield from self._images(event)
        yield from self._depth(event)
        yield from self._plots.stepped(event, self._world.model, self._world.placements)
        for step in event.steps:
            yield from self._log(step)
            self._last[step.method] = step
        yield Entry("decisions", rr.TextDocument(self._summary(), media_type="text/markdown"))

    def _images(self, event: Stepped) -> Iterator[Entry]:
        """Yields images and tracks of a frame. If it came without its image (see history/feed.py), the image comes
        later with `Pictured`."""
        yield from self._pictured(event)
        yield from self._lines(event)
        if event.exposure.kind == CAMERAS:
            yield from self._tracks_of_others(event)
        main = main_image(event.exposure)
        seen = None if main is None else _seen(event, main[0])
        if main is None or seen is None:
            return
        name = main[0]
        self._coloured.learn(seen)
        camera = self.opened.sequence.rig.camera(name)
        recent = self._recent[name] = [*self._recent.get(name, []), seen.tracks][-entities.TRAIL_LENGTH - 1 :]
        shown = entities.thinned(seen.tracks, camera)
        yield from self._coloured.entries(seen, shown)
        yield Entry(f"{name}/trails", entities.trails([*recent[:-1], shown], camera))
        yield from self._tracks(seen, shown)

    def _pictured(self, event: Stepped | Pictured) -> Iterator[Entry]:
        """Yields the frame's images, if they can (still) be read."""
        name, image = main_image(event.exposure) or ("", None)
        if image is not None and image.size:
            yield Entry(f"{name}/image", entities.jpeg(image))
            yield from self._world.picture(name, image, event.steps)
        if is_stereo(event.exposure) and event.exposure.right.size:
            yield Entry("right/image", entities.jpeg(event.exposure.right))
        if event.exposure.kind == CAMERAS:
            for camera, picture in images_of(event.exposure).items():
                if picture.size:
                    yield Entry(f"{image_root(camera)}/image", entities.jpeg(picture))

    def _tracks_of_others(self, event: Stepped) -> Iterator[Entry]:
        """Yields tracks in the cameras of a rig of any cameras, for each camera those of the first method that has
        any."""
        for name in images_of(event.exposure):
            if (seen := _seen(event, name)) is not None:
                camera = self.opened.sequence.rig.camera(name)
                shown = entities.thinned(seen.tracks, camera)
                yield Entry(f"{image_root(name)}/tracks", entities.points(shown, camera))

    def _depth(self, event: Stepped) -> Iterator[Entry]:
        if not is_stereo(event.exposure) or not (self._depth_path or self._has_depth()):
            return
        drawn = depth_entries(event.exposure, event.steps, self.opened.sequence.rig) if self._has_depth() else ()
        entry = next(iter(drawn), None)
        if self._depth_path and (entry is None or entry.path != self._depth_path):
            yield Entry(self._depth_path, rr.Clear(recursive=False))
        self._depth_path = entry.path if entry is not None else ""
        if entry is not None:
            yield entry

    def _tracks(self, seen: Seen, shown: Tracks) -> Iterator[Entry]:
        camera = self.opened.sequence.rig.camera(seen.camera)
        yield Entry(f"{seen.camera}/tracks", entities.points(shown, camera))
        moved = seen.moved
        yield from entities.legend(f"{seen.camera}/legend", seen.tracks, moved, camera)
        if moved is not None:
            self._moving.add(seen.camera)
        if seen.camera in self._moving:
            drawn = rr.Clear(recursive=False) if moved is None else entities.moving(moved, camera)
            yield Entry(f"{seen.camera}/moving", drawn)
        if seen.camera == "left":
            yield Entry(f"{seen.camera}/disparity", entities.disparities(shown, camera))
            yield Entry("right/tracks", entities.points(entities.in_right(shown), camera))

    def _lines(self, event: Stepped) -> Iterator[Entry]:
        """Yields the lines of the first method that has any in a camera of this frame."""
        for camera in images_of(event.exposure):
            found = next((s.lines[camera] for s in event.steps if len(s.lines.get(camera, ()))), None)
            if found is not None:
                self._lined.add(camera)
                drawn = entities.image_lines(found, self.opened.sequence.rig.camera(camera))
                yield Entry(f"{image_root(camera)}/lines", drawn)
            elif camera in self._lined:
                self._lined.discard(camera)
                yield Entry(f"{image_root(camera)}/lines", rr.Clear(recursive=False))

    def _log(self, step: Step) -> Iterator[Entry]:
        before, now = self._words.get(step.method), MethodStatus.of(step, None)
        self._words[step.method] = now.word
        if before != now.word:
            level = "WARN" if now.severity.alarming else "INFO"
            yield Entry("log", rr.TextLog(f"{step.method}: {now.word}", level=level))
        if step.key_frame:
            yield Entry("log", rr.TextLog(f"{step.method}: keyframe", level="DEBUG"))

    def _summary(self) -> str:
        steps = {m: self._last[m] for m in self.opened.methods if m in self._last}
        placed = self._world.placements
        units_m = {m: unit_in_metres(m, placed.get(m, Similarity()).scale) for m in steps}
        return entities.summary(steps, self.first_ns, units_m)


def _seen(event: Stepped | Pictured, camera: FrameName) -> Seen | None:
    """Returns the tracks that a method, or one inside it, has in this camera."""
    step = next((s for s in with_parts(event.steps) if camera in s.tracks), None)
    return None if step is None else Seen(event.index, step, camera, step.tracks[camera])
