"""Absolute poses from tags: squares with a number in them, put up for the purpose (auxiliary features).

Detection: Garrido-Jurado et al., Automatic generation and detection of highly reliable fiducial markers, Pattern
Recognition 2014 (OpenCV's aruco, which reads AprilTags, too). Two poses of a square: Collins and Bartoli, Infinitesimal
plane-based pose estimation (IPPE), IJCV 2014. Map of tags: Munoz-Salinas et al., Mapping and localization from planar
markers, Pattern Recognition 2018.

The steps, in the order of this file:

1. Tags of the dictionary are found; their corners are refined to the sub-pixel.
2. The first tag whose pose is clear is the world: its centre is the origin, x to its right, y down, z into it. Its side
   `side_m` makes all metric. With a map of surveyed tags (`map`) the world is the survey's, and poses are absolute.
3. The pose of a frame is fitted to all corners of known tags. A square that is seen from afar has two poses, mirrored
   about the line of sight: all of them compete over all tags, and where two fit alike the one near the last frame wins.
4. A new tag competes with its two poses over several frames, and becomes known when one of them is clearly better.
5. Frames from new directions are kept as key images, in a bounded number. Their poses and those of the tags are
   adjusted together; surveyed tags are fixed. A tag that no key image shows any more stays where it is.

Figures: rendered tags of 40 px: 0.2 degrees from the third key image on, 0.4 with two; before that the poses have the
tilt of the first tag as a single view gives it, 2 degrees here, and are not corrected later. 15 real images of a table
with tags: all located, reprojection errors of 0.85 px (median) and 1.13 px (mean). With a map, absolute errors over 40
frames of the rendered tags, median and largest: 0.05 and 0.31 degrees, 0.9 and 5.4 mm with two of five tags surveyed;
0.15 and 2.1 degrees, 3 and 36 mm with one.

Fails without a known tag in the image, and where a tag moves. The error of a single small tag is large: with 40 px of
side, a tenth of a pixel is 0.5 degrees of tilt. A wrong `side_m` is an error of scale that only a map of several tags
reveals. With a map, frames before the first surveyed tag have no pose, and errors of the survey are in the poses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Annotated, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.estimator import VIDEO, Method
from ispom.estimators.survey.common import OneKind, Result, tracks_between
from ispom.geometry import Array, Pose, rotation_angle_rad, skew
from ispom.io.files import expanded
from ispom.io.tag_map import read_tag_map
from ispom.numerics.levenberg_marquardt import minimise
from ispom.numerics.reprojection import reprojected
from ispom.numerics.robust import robust_cost, robust_loss, robust_weights
from ispom.settings import NamesFile, Range, checked
from ispom.solvers.least_squares import Derivatives, Family, Loss, Problem, adjust
from ispom.stopwatch import Stopwatch
from ispom.types import (
    Check,
    Decision,
    Frame,
    Image,
    ImageLines,
    Landmarks,
    Rig,
    WorldLines,
    as_grey,
    by_key,
    colours_at,
)

Poses = tuple[list[Pose], list[Pose]]
"""Camera_from_world of key images, and world_from_tag of tags."""
Dictionary = Literal[
    "apriltag_36h11", "apriltag_25h9", "apriltag_16h5", "aruco_original",
    "4x4_50", "4x4_250", "5x5_250", "6x6_250", "7x7_250",
]  # fmt: skip
UNIT_CORNERS = np.array([(-0.5, -0.5, 0.0), (0.5, -0.5, 0.0), (0.5, 0.5, 0.0), (-0.5, 0.5, 0.0)])
"""(4, 3) clockwise from the top left, as the detector gives them, y down."""
SAMPLES, PROFILE = 24, 25
"""Points along an edge, and samples of the light across it at each."""
REACH, MAX_REACH_PX = 0.06, 4.0
"""Half the length of the samples across an edge, relative to the edge (a cell has 1/8 or more of it), and at most."""
OFF_EDGE_PX = 0.7
"""A point so far from the others' median is not on the edge: something covers it."""
MAX_REFINED_PX, MIN_SINE = 3.0, 0.2
"""Largest correction of a corner, and sine of the angle of its edges."""
LOSS_PX = 2.0
"""Width of the robust loss [px]: the error of corners of blurred tags, or of bent paper."""
PLAIN_PX = 1e3
"""Width of a loss that is quadratic for all errors that occur [px]."""
FLOOR_PX = 0.1
"""Error of a refined corner [px]: two fits that are both better than this are equally good."""
CLEAR = 2.0
"""Ratio of the errors of two poses from which on the better one is right."""
SAME_RAD = np.radians(4.0)
"""Poses nearer than this are one pose."""
NEW_VIEW_RAD, NEW_VIEW_SHARE = np.radians(12.0), 0.2
"""Rotation, and displacement relative to the distance from the tags, from which on a view is a new one."""
MAX_SIGHTINGS, MAX_TAGS = 6, 100
"""Most observations of a tag that is not known yet; most known tags, without those of a map."""
ITERATIONS, TOLERANCE = 30, 1e-5

IN_IMAGE = Check(
    "known_tags", "known tags in the image", "requirement", "Frame located?",
    passes="{value} known tags are in the image.",
    fails="No known tag is in the image.",
)  # fmt: skip
POSE = Check(
    "tag_corners", "corners that fit the pose", "requirement", "Frame located?", topic="pose",
    passes="Located: {value} corners of tags fit the pose ({threshold} needed).",
    fails="Lost: {value} corners of known tags fit one pose ({threshold} needed).",
)  # fmt: skip
ERROR = Check(
    "tag_error", "reprojection error of the corners", "warning", "Frame located?", "<=", "px",
    passes="The corners fit within {value:.2f} px (limit {threshold:.2f}).",
    fails="The corners fit only within {value:.2f} px (limit {threshold:.2f}): a tag moved, is bent, "
    "or is wrong in the map.",
)  # fmt: skip
AMBIGUITY = Check(
    "second_pose", "error of the second pose over that of the first", "finding", "Which of two poses?",
    passes="One pose: the mirrored one fits {value:.1f} times as badly ({threshold:.1f} is clear).",
    fails="Two poses fit: the mirrored one fits {value:.1f} times as badly ({threshold:.1f} is clear). The one near "
    "the last frame is taken.",
)  # fmt: skip
NEW_TAGS = Check(
    "new_tags", "tags that became known", "finding", "New tags?",
    passes="{value} new tags are in the map.",
    fails="No new tag is in the map.",
)  # fmt: skip
CHECKS = by_key(IN_IMAGE, POSE, ERROR, AMBIGUITY, NEW_TAGS)
STAGES = {
    "detect": "Finds tags, reads their numbers, and refines their corners.",
    "pose": "Fits the pose to all corners of known tags, from both poses of each of them.",
    "map": "Tries both poses of new tags over several frames, and adjusts key images and tags together.",
}


@dataclass(frozen=True)
class TagsConfig:
    """Settings of the tags method."""

    dictionary: Dictionary = "apriltag_36h11"
    """Family of the tags."""
    side_m: Annotated[float, Range(0.001, 10)] = 0.16
    """Side of the black square of each tag [m]: it gives the scale."""
    max_error_px: Annotated[float, Range(0.2, 20)] = 3.0
    """Largest reprojection error of a corner that fits the pose [px]."""
    key_images: Annotated[int, Range(2, 40)] = 16
    """Largest number of frames that are adjusted together with the tags."""

    map: Annotated[str, NamesFile()] = ""
    """YAML file with the surveyed places of all tags or some, whose world it then is; empty: the first tag is the
    world."""

    def build(self, rig: Rig) -> TagPoses:
        config = checked(self)
        return TagPoses(rig, config, surveyed(config) if config.map else ())


@dataclass(frozen=True, eq=False)
class Tag:
    """A tag of known pose."""

    id: int
    world_from_tag: Pose


def surveyed(config: TagsConfig) -> tuple[Tag, ...]:
    """Returns the tags of the map. Raises InputError where it is none, or has a tag that the dictionary lacks."""
    path = expanded(config.map)
    poses = read_tag_map(path, config.side_m * UNIT_CORNERS)
    count = len(dictionary_of(config.dictionary).bytesList)
    if (most := max(poses)) >= count:
        raise InputError(f"{path}: tag {most} is none of {config.dictionary}, which has {count}: correct it")
    return tuple(Tag(number, pose) for number, pose in sorted(poses.items()))


def dictionary_of(name: Dictionary) -> cv2.aruco.Dictionary:
    """Returns OpenCV's dictionary."""
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name.upper()}"))


@dataclass(frozen=True, eq=False)
class View:
    """The N tags of one frame."""

    ids: NDArray[np.int64]
    """(N,) each once, ascending."""
    uv: NDArray[np.float32]
    """(N, 4, 2) corners [px]."""
    x: Array
    """(N, 4, 2) normalised corners."""
    camera_from_world: Pose = Pose()

    def of(self, some: NDArray[np.bool_]) -> View:
        return replace(self, ids=self.ids[some], uv=self.uv[some], x=self.x[some])


@dataclass(frozen=True, eq=False)
class Memory:
    """The map of tags, and the frames that hold it."""

    tags: tuple[Tag, ...] = ()
    """The surveyed ones, which are fixed; without any, the first one is the world."""
    surveyed: tuple[Tag, ...] = ()
    """Tags of the map that was given."""
    key_images: tuple[View, ...] = ()
    sightings: tuple[View, ...] = ()
    """Each of one tag that is not known yet."""
    last: View | None = None
    """The last frame with a pose."""


class TagPoses(OneKind[Memory]):
    """The estimator of the method `tags`; `known` tags are a map that was made before."""

    kind, frame = "video", "rig"

    def __init__(self, rig: Rig, config: TagsConfig, known: tuple[Tag, ...] = ()) -> None:
        self.rig, self.config, self.known = rig, config, known
        self.camera, self.rig_from_video = rig.camera("video"), rig.rig_from_video
        self.corners = config.side_m * UNIT_CORNERS
        self.px = 1 / self.camera.fx

    def begin(self) -> Memory:
        """See OneKind."""
        return Memory(self.known, self.known)

    def process(self, memory: Memory, frame: Frame, watch: Stopwatch) -> tuple[Memory, Result]:
        """See OneKind: one frame."""
        grey = as_grey(frame.image)
        view = self.detect(grey)
        watch.lap("detect")

        began_again = False
        if memory.surveyed is not self.known:  # built again, perhaps with another map: a fork
            began_again = not _same(memory.surveyed, self.known)
            memory = self.begin() if began_again else replace(memory, surveyed=self.known)
        if not memory.tags and not self.known:
            memory = replace(memory, tags=self._first_tag(view))
        pose, errors, decisions = self._locate(memory, view)
        watch.lap("pose")

        is_key = False
        if pose is not None:
            view = replace(view, camera_from_world=pose)
            memory, is_key, new = self._extend(memory, view, decisions[-1].passed)
            decisions = (*decisions, NEW_TAGS.of(new, 1))
        watch.lap("map")

        result = self._shown(memory, view, frame.image, errors, decisions)
        if pose is None:
            return memory, result
        camera_from_world = next((v.camera_from_world for v in memory.key_images if v.uv is view.uv), pose)
        memory = replace(memory, last=replace(view, camera_from_world=camera_from_world))
        located = (self.rig_from_video @ camera_from_world).inverse()
        return memory, replace(result, pose=located, key_frame=is_key, restarted=began_again)

    # Step 1: tags in the image

    @cached_property
    def _detector(self) -> cv2.aruco.ArucoDetector:
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        return cv2.aruco.ArucoDetector(dictionary_of(self.config.dictionary), parameters)

    def detect(self, grey: Image) -> View:
        """Returns the tags of an image; those whose number occurs twice are skipped."""
        corners, ids, _ = self._detector.detectMarkers(grey)
        if ids is None or not len(ids):
            return View(np.zeros(0, np.int64), np.zeros((0, 4, 2), np.float32), np.zeros((0, 4, 2)))
        unique, index, counts = np.unique(ids.ravel(), return_index=True, return_counts=True)
        height, width = grey.shape
        uv = np.array(corners, np.float32).reshape(-1, 4, 2)[index[counts == 1]]
        uv = np.clip(uv, 0, np.array([width - 1, height - 1], np.float32))
        uv = refined_corners(grey, uv)
        x = self.camera.normalise(uv.reshape(-1, 2).astype(float)).reshape(-1, 4, 2)
        return View(unique[counts == 1].astype(np.int64), uv, x)

    # Step 2: the world

    def _first_tag(self, view: View) -> tuple[Tag, ...]:
        """Returns the tag whose pose is the clearest, at the origin; none where each has two poses."""
        clear = []
        for tag, x in zip(view.ids, view.x, strict=True):
            pose, ratio = self._ranked(self.corners, x, self.two_poses(x), None)
            fits = pose is not None and self._errors(pose, self.corners, x).max() <= self.config.max_error_px * self.px
            clear += [(ratio, -int(tag))] if fits and ratio >= CLEAR else []
        return (Tag(-max(clear)[1], Pose()),) if clear else ()

    def two_poses(self, x: Array) -> list[Pose]:
        """Returns both camera_from_tag of normalised corners (4, 2)."""
        _, turns, places, _ = cv2.solvePnPGeneric(self.corners, x, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
        poses = [
            Pose.from_rotvec(np.asarray(r, float), np.asarray(t, float)) for r, t in zip(turns, places, strict=True)
        ]
        return [pose for pose in poses if np.isfinite(pose.matrix).all() and pose.translation[2] > 0]

    # Step 3: the pose of the frame

    def _locate(self, memory: Memory, view: View) -> tuple[Pose | None, Array, tuple[Decision, ...]]:
        """Returns camera_from_world, the errors (K,) of the known tags' corners [px], and the checks."""
        world_from_tag = {tag.id: tag.world_from_tag for tag in memory.tags}
        seen = view.of(np.isin(view.ids, list(world_from_tag)))
        decisions = (IN_IMAGE.of(len(seen.ids), 1),)
        if not len(seen.ids):
            return None, np.zeros(0), decisions
        xyz = np.concatenate([world_from_tag[int(i)].apply(self.corners) for i in seen.ids])
        x = seen.x.reshape(-1, 2)
        guesses = [] if memory.last is None else [memory.last.camera_from_world]
        for tag, corners in zip(seen.ids, seen.x, strict=True):
            guesses += [pose @ world_from_tag[int(tag)].inverse() for pose in self.two_poses(corners)]
        before = None if memory.last is None else memory.last.camera_from_world.rotation
        pose, ratio = self._ranked(xyz, x, guesses, before)
        errors = np.full(len(x), np.inf) if pose is None else self._errors(pose, xyz, x) / self.px
        fits = errors <= self.config.max_error_px
        decisions = (*decisions, POSE.of(fits.sum(), 4))
        if pose is None or not decisions[-1].passed:
            return None, np.zeros(0), decisions
        error = float(np.sqrt((errors[fits] ** 2).mean()))
        return pose, errors, (*decisions, ERROR.of(error, LOSS_PX), AMBIGUITY.of(ratio, CLEAR))

    def _ranked(self, xyz: Array, x: Array, guesses: list[Pose], before: Array | None) -> tuple[Pose | None, float]:
        """Returns the pose of points (N, 3) at normalised x (N, 2) that fits best, and by how much worse another does.

        Where two are equally good, it is the one nearer to the rotation `before`.
        """
        fitted = [self._fitted(xyz, x, guess) for guess in guesses]
        if not fitted:
            return None, 1.0
        costs = [self._rms(pose, xyz, x) for pose in fitted]
        best = fitted[int(np.argmin(costs))]
        others = [i for i, p in enumerate(fitted) if rotation_angle_rad(p.rotation.T @ best.rotation) > SAME_RAD]
        if not others:
            return best, 1e3
        second = min(others, key=lambda i: costs[i])
        ratio = min(costs[second] / max(min(costs), FLOOR_PX * self.px), 1e3)
        if ratio < CLEAR and before is not None:
            best = min(best, fitted[second], key=lambda p: float(rotation_angle_rad(p.rotation.T @ before)))
        return best, ratio

    def _fitted(self, xyz: Array, x: Array, guess: Pose) -> Pose:
        """Returns camera_from_world after Gauss-Newton with damping, from a guess.

        Four corners hardly reveal an outlier among them: theirs are plain least squares.
        """
        width = (LOSS_PX if len(x) > 4 else PLAIN_PX) * self.px

        def stepped(pose: Pose, damping: float) -> Pose:
            q = pose.apply(xyz)
            seen, _, by = reprojected(q)
            error = x - seen
            weight = robust_weights((error**2).sum(axis=1), width)
            normal = np.einsum("n,nik,nil->kl", weight, by, by)
            normal += damping * np.diag(np.diag(normal)) + 1e-12 * np.eye(6)
            return Pose.exp(np.linalg.solve(normal, np.einsum("n,nik,ni->k", weight, by, error))) @ pose

        def cost(pose: Pose) -> float:
            return robust_cost(self._errors(pose, xyz, x) ** 2, width)

        return minimise(guess, cost, stepped, ITERATIONS, TOLERANCE).values

    def _errors(self, camera_from_world: Pose, xyz: Array, x: Array) -> Array:
        """Returns normalised reprojection errors (N,); large behind the camera."""
        q = camera_from_world.apply(xyz)
        ahead = q[:, 2] > 1e-6
        error = q[:, :2] / np.where(ahead, q[:, 2], 1.0)[:, None] - x
        return np.where(ahead, np.sqrt((error**2).sum(axis=1)), 1e3)

    def _rms(self, pose: Pose, xyz: Array, x: Array) -> float:
        """Returns the root mean square error, outliers limited to ten loss widths."""
        return float(np.sqrt((np.minimum(self._errors(pose, xyz, x), 10 * LOSS_PX * self.px) ** 2).mean()))

    # Step 4: new tags

    def _extend(self, memory: Memory, view: View, clear: bool) -> tuple[Memory, bool, int]:
        """Returns the memory after a located frame, whether it is a key image, and how many tags became known."""
        is_new = clear and self._is_new(memory, view)
        if not is_new:
            return memory, False, 0
        known = {tag.id for tag in memory.tags}
        unknown = [view.of(view.ids == i) for i in view.ids if int(i) not in known]
        sightings = [*memory.sightings, *unknown]
        tags = list(memory.tags)
        for tag in sorted({int(v.ids[0]) for v in unknown}):
            views = [v for v in sightings if v.ids[0] == tag]
            pose = self._placed(views)
            if pose is not None and len(tags) - len(self.known) < MAX_TAGS:
                tags.append(Tag(tag, pose))
        placed = {tag.id for tag in tags}
        waiting = [v for v in sightings if int(v.ids[0]) not in placed][-MAX_SIGHTINGS * MAX_TAGS :]
        waiting = [v for n, v in enumerate(waiting) if sum(v.ids[0] == w.ids[0] for w in waiting[n:]) <= MAX_SIGHTINGS]
        key_images = (*memory.key_images, view)
        key_images = _thinned(key_images, self.config.key_images)
        memory = replace(memory, tags=tuple(tags), key_images=key_images, sightings=tuple(waiting))
        return self._adjusted(memory), True, len(tags) - len(known)

    def _is_new(self, memory: Memory, view: View) -> bool:
        """Checks for a direction, or a set of tags, that no key image has."""
        pose = view.camera_from_world
        distance = np.median([(pose @ t.world_from_tag).translation[2] for t in memory.tags if t.id in view.ids])
        for key in memory.key_images:
            moved = pose @ key.camera_from_world.inverse()
            near = np.linalg.norm(moved.translation) < NEW_VIEW_SHARE * abs(distance)
            if near and rotation_angle_rad(moved.rotation) < NEW_VIEW_RAD and np.isin(view.ids, key.ids).all():
                return False
        return True

    def _placed(self, views: list[View]) -> Pose | None:
        """Returns world_from_tag of a tag seen in these views; None where two poses fit all of them."""
        candidates = [v.camera_from_world.inverse() @ pose for v in views for pose in self.two_poses(v.x[0])]
        errors = []
        for pose in candidates:
            xyz = pose.apply(self.corners)
            errors.append(float(np.sqrt(np.mean([self._rms(v.camera_from_world, xyz, v.x[0]) ** 2 for v in views]))))
        if not errors:
            return None
        best = candidates[int(np.argmin(errors))]
        turned = [rotation_angle_rad(pose.rotation.T @ best.rotation) > SAME_RAD for pose in candidates]
        second = min((e for e, other in zip(errors, turned, strict=True) if other), default=np.inf)
        clear = second >= CLEAR * max(min(errors), FLOOR_PX * self.px)
        return best if clear and min(errors) <= self.config.max_error_px * self.px else None

    # Step 5: key images and tags, adjusted together

    def _adjusted(self, memory: Memory) -> Memory:
        """Minimises the reprojection errors of all corners over poses of key images, and of tags but for the
        surveyed ones, or else the first."""
        index = {tag.id: n for n, tag in enumerate(memory.tags)}
        views = memory.key_images
        pairs = [(k, index[int(i)], n) for k, v in enumerate(views) for n, i in enumerate(v.ids) if int(i) in index]
        view_of, tag_of = np.array([p[0] for p in pairs]), np.array([p[1] for p in pairs])
        x = np.stack([views[k].x[n] for k, _, n in pairs])
        fixed = set(range(len(self.known))) or {0 if 0 in tag_of else int(tag_of.min())}
        free = [n for n in sorted(set(tag_of.tolist())) if n not in fixed]
        column = np.full(len(memory.tags), -1)
        column[free] = 6 * (len(views) + np.arange(len(free)))
        corners = Corners(view_of, tag_of, column, self.corners, x, np.full(4 * len(pairs), LOSS_PX * self.px))

        def moved(poses: Poses, shared: Array, _: Array) -> Poses:
            step = shared.reshape(-1, 6)
            cameras = [Pose.exp(d) @ pose for d, pose in zip(step, poses[0], strict=False)]
            tags = list(poses[1])
            for n, d in zip(free, step[len(views) :], strict=True):
                tags[n] = tags[n] @ Pose.exp(d)
            return cameras, tags

        start = [v.camera_from_world for v in views], [tag.world_from_tag for tag in memory.tags]
        problem = Problem((corners,), moved, 6 * (len(views) + len(free)))
        cameras, tags = adjust(problem, start, ITERATIONS, TOLERANCE).values
        return replace(
            memory,
            tags=tuple(replace(t, world_from_tag=p) for t, p in zip(memory.tags, tags, strict=True)),
            key_images=tuple(replace(v, camera_from_world=p) for v, p in zip(views, cameras, strict=True)),
        )

    # What is drawn

    def _shown(
        self, memory: Memory, view: View, image: Image, errors: Array, decisions: tuple[Decision, ...]
    ) -> Result:
        """Returns corners as tracks, outlines on the image, and the sides of known tags in the scene."""
        known = np.isin(view.ids, [tag.id for tag in memory.tags])
        ids = (4 * view.ids[:, None] + np.arange(4)).ravel()
        before = np.full((len(ids), 2), np.nan)
        if memory.last is not None:
            old = (4 * memory.last.ids[:, None] + np.arange(4)).ravel()
            _, here, there = np.intersect1d(ids, old, return_indices=True)
            before[here] = memory.last.uv.reshape(-1, 2)[there]
        world_from_tag = {tag.id: tag.world_from_tag for tag in memory.tags}
        xyz = np.array([pose.apply(self.corners) for pose in world_from_tag.values()]).reshape(-1, 4, 3)
        colour = np.full((len(xyz), 4, 3), 255, np.uint8)
        visible = [n for n, i in enumerate(world_from_tag) if i in view.ids]
        for n in visible:
            uv = view.uv[view.ids == list(world_from_tag)[n]][0]
            colour[n] = colours_at(image, uv)
        group = np.array(list(world_from_tag), np.int64)
        return Result(
            decisions=decisions,
            tracks={"video": tracks_between(ids, view.uv.reshape(-1, 2), before)},
            landmarks=Landmarks((4 * group[:, None] + np.arange(4)).ravel(), xyz.reshape(-1, 3), colour.reshape(-1, 3)),
            residuals_px=errors[errors <= self.config.max_error_px],
            lines={"video": ImageLines.of(_sides(view.uv), np.repeat(np.where(known, view.ids, -1), 4))},
            world_lines=WorldLines(_sides(xyz), np.repeat(group, 4)),
        )


@dataclass(frozen=True, eq=False)
class Corners(Family[Poses]):
    """Errors of the corners of tags in key images, normalised: P tags in an image."""

    view: NDArray[np.int64]
    """(P,) key image of each observation; its pose has the first columns."""
    tag: NDArray[np.int64]
    """(P,) tag of each observation."""
    column: NDArray[np.int64]
    """(T,) first column of each tag; -1 for a fixed tag."""
    corners: Array
    """(4, 3) in the tag."""
    x: Array
    """(P, 4, 2) observed, normalised."""
    widths: Array
    loss: Loss = robust_loss

    def residuals(self, values: Poses) -> Array:
        q = self._in_camera(values)[0].reshape(-1, 3)
        return np.where(q[:, 2:] > 0, q[:, :2] / q[:, 2:] - self.x.reshape(-1, 2), np.nan)

    def derivatives(self, values: Poses) -> Derivatives:
        q, turned = self._in_camera(values)
        flat = q.reshape(-1, 3)
        _, by_point, by_camera = reprojected(np.where(flat[:, 2:] > 0, flat, [0, 0, 1.0]))
        by_corner = by_point @ np.repeat(turned, 4, axis=0)
        by_tag = np.concatenate([by_corner, -by_corner @ skew(np.tile(self.corners, (len(q), 1)))], axis=2)
        first = np.stack([6 * self.view, self.column[self.tag]], axis=1)[..., None]
        columns = np.where(first >= 0, first + np.arange(6), -1).reshape(-1, 12)
        return Derivatives.of_shared(np.concatenate([by_camera, by_tag], axis=2), np.repeat(columns, 4, axis=0))

    def _in_camera(self, values: Poses) -> tuple[Array, Array]:
        """Returns the corners (P, 4, 3) and camera_from_tag rotations (P, 3, 3)."""
        poses = [values[0][k] @ values[1][t] for k, t in zip(self.view, self.tag, strict=True)]
        turned, shifted = np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses])
        return np.einsum("nij,cj->nci", turned, self.corners) + shifted[:, None], turned


def refined_corners(grey: Image, uv: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns corners (N, 4, 2) [px] where straight lines through the four edges of each tag meet.

    Each edge is measured at many points, so that its lines are several times as exact as a corner by itself. A corner
    that this moves by more than MAX_REFINED_PX is left unchanged.
    """
    height, width = grey.shape
    start, end = uv.astype(float), np.roll(uv, -1, axis=1).astype(float)
    along = end - start
    length = np.maximum(np.linalg.norm(along, axis=2), 1.0)
    outwards = np.stack([along[..., 1], -along[..., 0]], axis=2) / length[..., None]  # clockwise, y down
    reach = np.clip(REACH * length, 1.0, MAX_REACH_PX)[..., None, None] * np.linspace(-1, 1, PROFILE)
    at = start[:, :, None] + np.linspace(0.12, 0.88, SAMPLES)[:, None] * along[:, :, None]
    places = at[..., None, :] + reach[..., None] * outwards[:, :, None, None]
    flat = places.astype(np.float32).reshape(-1, SAMPLES * PROFILE, 2)
    light = cv2.remap(
        grey.astype(np.float32), flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    slope = np.maximum(np.diff(light.reshape(*places.shape[:-1]).astype(float), axis=-1), 0)
    slope *= slope >= 0.3 * slope.max(axis=-1, keepdims=True)
    middle = 0.5 * (reach[..., 1:] + reach[..., :-1])
    offset = (slope * middle).sum(-1) / np.maximum(slope.sum(-1), 1e-9)
    edge = at + offset[..., None] * outwards[:, :, None]
    weight = (np.abs(offset - np.median(offset, axis=-1, keepdims=True)) < OFF_EDGE_PX).astype(float)[..., None]
    mean = (weight * edge).sum(2) / np.maximum(weight.sum(2), 1)
    apart = weight * (edge - mean[:, :, None])
    normal = np.linalg.eigh(np.einsum("nski,nskj->nsij", apart, apart))[1][..., :, 0]
    before = np.roll(normal, 1, axis=1)
    both = np.stack([before, normal], axis=2)
    distances = np.stack([(before * np.roll(mean, 1, axis=1)).sum(-1), (normal * mean).sum(-1)], axis=2)
    safe = np.abs(np.linalg.det(both)) > MIN_SINE
    met = np.linalg.solve(np.where(safe[..., None, None], both, np.eye(2)), distances[..., None])[..., 0]
    near = safe & (np.linalg.norm(met - start, axis=2) < MAX_REFINED_PX)
    inside = ((met >= 0) & (met <= np.array([width - 1, height - 1]))).all(axis=2)
    return np.where((near & inside)[..., None], met, start).astype(np.float32)


def _sides(corners: Array) -> Array:
    """Returns the four sides (4 N, 2, D) of squares (N, 4, D)."""
    return np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2, corners.shape[-1])


def _same(some: tuple[Tag, ...], others: tuple[Tag, ...]) -> bool:
    """Checks that two maps have the same tags at the same places."""
    return [t.id for t in some] == [t.id for t in others] and all(
        np.array_equal(a.world_from_tag.matrix, b.world_from_tag.matrix) for a, b in zip(some, others, strict=True)
    )


def _thinned(views: tuple[View, ...], most: int) -> tuple[View, ...]:
    """Returns at most `most` views: of the two nearest ones, the older is discarded."""
    while len(views) > most:
        poses = [view.camera_from_world for view in views]
        distances = [float(np.linalg.norm((a @ b.inverse()).log())) for a, b in pairwise(poses)]
        drop = int(np.argmin(distances[1:])) + 1 if len(views) > 2 else 0
        views = views[:drop] + views[drop + 1 :]
    return views


METHOD = Method(
    "tags",
    VIDEO,
    TagsConfig,
    "metric",
    "ArUco markers and AprilTags (Garrido-Jurado et al. 2014), IPPE (Collins and Bartoli 2014)",
    checks=CHECKS,
    stages=STAGES,
    survey="Table 3, one camera: auxiliary features",
    world="own",
)
