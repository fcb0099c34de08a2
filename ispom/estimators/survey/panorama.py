"""Orientation of a rotating camera by registration to images taken before: the paper's "registration" class with one
camera (Kourogi et al., Real-time image mosaicing from a video sequence, ICIP 1999, and A panorama-based method of
personal positioning and orientation, 2000; the spherical panorama as in Brown and Lowe, Automatic Panoramic Image
Stitching using Invariant Features, 2007).

The panorama is a set of key images with their orientations: features with directions on a sphere. The steps, in the
order of this file:

1. Features of the frame (SIFT or ORB) are matched to those of the nearest key images, or of all after a loss.
2. The rotation between two images is the one on which most matched rays agree: RANSAC over samples of two, then robust
   least squares on the sphere (Kabsch with weights).
3. A frame that sees two key images which were never compared compares them: so a turn closes. The orientations of all
   key images are then averaged over all comparisons, and with them those of all earlier frames.
4. The frame is registered to all near key images at once. If a large part of its view is in none of them, it becomes
   the next key image.
5. A check compares the matches that one rotation explains with those that a rotation and a translation do. Where it
   fails, it is tried whether another focal length would make it a rotation.

With `--panorama.reference` the images were captured before: a folder of them with their poses and camera. Each frame is
then found in that folder's world, by points that its images have in common or, where all are from one place, by
directions. No step above but the first two is taken, and nothing is added to the reference.

Limits. Without a reference, the position is that of the first frame, always: where the camera moves by more than about
a hundredth of the distance of what it sees, a rotation is no longer the truth, and the check `rotation_only` fails.
What moves in the scene must be the smaller part. A wrong focal length makes a turn close with a gap, which the
averaging only spreads.

Measured: sim:city?motion=pan, every 20th video frame of a turn and back: orientations within 0.06 degrees of the truth
(largest; ORB: 0.14). A film of a roller coaster by a panning telephone without calibration, 70 frames: all registered,
and the check names a focal length 1.6 times the guess; with that, a rotation explains 75 to 98 % of the rigid matches.
In the moving flight of sim:city, `rotation_only` fails at each frame until the panorama is lost.

With a reference, absolute errors of frames half-way between its images, median and largest: KITTI 06, images 2.4 m
apart, 8 and 24 mm of 25 frames; a handheld board, images 4 cm apart, 1.1 and 2.4 mm of 25; sim:indoor, images 1.2 m
apart, 0.7 and 3.8 mm of 22. With KITTI 06 as reference, none of 50 frames of KITTI 00 is found.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from typing import Annotated, Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.estimator import VIDEO, Method
from ispom.estimators.modern.verification import MIN_SHARE
from ispom.estimators.survey.common import OneKind, Result, State, tracks_between
from ispom.estimators.survey.reference_images import Extraction, Reference, View, read_reference
from ispom.features.orb import ORB, ORB_MATCHER
from ispom.features.sift import SIFT, SIFT_MATCHER
from ispom.geometry import Array, Pose, Similarity, rotation_angle_rad, so3_exp, so3_log
from ispom.numerics.robust import robust_weights
from ispom.persistent_list import PersistentList
from ispom.settings import NamesFile, Range, checked
from ispom.solvers.localisation import Policy, locate, resect
from ispom.solvers.multiview.essential import inlier_distances
from ispom.solvers.pose_graph import Edge, optimise
from ispom.stopwatch import Stopwatch
from ispom.types import Check, Decision, Frame, Image, Landmarks, Rig, Trajectory, as_grey, by_key, colours_at

FEATURES = {"sift": (SIFT, SIFT_MATCHER), "orb": (ORB, ORB_MATCHER)}
COMPARED = 4
"""Key images that a frame is compared with: those whose axes are nearest to the predicted one."""
SAMPLES = 200
"""Number of samples of two matches. If 25 % of the matches are right, one of 200 samples is right at 99.99 %."""
ITERATIONS = 6
"""Iterations of weighted least squares, each with new weights."""
RIGID_SAMPLES = 300
"""Number of samples of seven matches for the check `rotation_only`. If sampling fails, the check passes."""
FOCAL_FACTORS = np.geomspace(0.4, 2.5, 21)
"""Focal lengths that are tried: from a guess for any lens of a telephone or a video camera."""
NOISE_PX = 1.0
"""Standard deviation of a match, by which comparisons of key images are weighted."""

FEATURE_COUNT = Check(
    "panorama_features", "features of the image", "requirement", "Panorama possible?",
    passes="The panorama begins with {value} features ({threshold} needed).",
    fails="No panorama: the image has {value} features ({threshold} needed).",
)  # fmt: skip
INLIERS = Check(
    "registered_matches", "matches that agree with one rotation", "requirement", "Registered?", topic="pose",
    passes="Registered to the panorama: {value} matches agree with one rotation ({threshold} needed).",
    fails="Lost: {value} matches with the panorama agree with one rotation ({threshold} needed).",
)  # fmt: skip
ROTATION = Check(
    "rotation_only", "share of rigid matches that a rotation explains", "warning",
    passes="The camera only rotates: this explains {value:.0%} of the rigid matches (limit {threshold:.0%}).",
    fails="Not a rotation: one explains only {value:.0%} of the rigid matches (limit {threshold:.0%}).",
)  # fmt: skip
FOCAL = Check(
    "focal_factor", "focal length at which a rotation explains most, relative to the calibration's", "finding",
    passes="The focal length is wrong: with {value:.2f} times that of the calibration the camera only rotates.",
    fails="The camera translates: with no focal length it only rotates (nearest at {value:.2f} times).",
)  # fmt: skip
NEW_VIEW = Check(
    "new_view", "angle to the nearest key image", "trigger", "New key image?", unit="degrees",
    passes="New key image: the view is {value:.1f} degrees from the nearest one (limit {threshold:.1f}).",
    fails="The view is {value:.1f} degrees from the nearest key image: no new one (limit {threshold:.1f}).",
)  # fmt: skip
CLOSED = Check(
    "gap_closed", "gap between key images of two passes, compared for the first time", "finding",
    relation="<=", unit="degrees", topic="loop",
    passes="The panorama closes with a gap of {value:.2f} degrees (limit {threshold}), which averaging removed.",
    fails="The panorama closes with a gap of {value:.2f} degrees (limit {threshold}): check the focal length.",
)  # fmt: skip
REFERENCE_MATCHES = Check(
    "reference_matches", "matches with reference images that fit one pose", "requirement", "Found?", topic="pose",
    passes="Found in the reference images: {value} matches fit one pose ({threshold} needed).",
    fails="Not found in the reference images: {value} matches fit one pose ({threshold} needed).",
)  # fmt: skip
REFERENCE_SHARE = Check(
    "reference_share", "share of the matches with the best reference image that fit the pose", "requirement", "Found?",
    topic="pose",
    passes="{value:.0%} of the matches with the best reference image fit the pose ({threshold:.0%} needed).",
    fails="Only {value:.0%} of the matches with the best reference image fit the pose ({threshold:.0%} needed).",
)  # fmt: skip
CHECKS = by_key(FEATURE_COUNT, INLIERS, ROTATION, FOCAL, NEW_VIEW, CLOSED, REFERENCE_MATCHES, REFERENCE_SHARE)
STAGES = {
    "features": "Detects and describes the features of the frame.",
    "compare": "Matches them to the nearest key images, and finds the rotation to each.",
    "average": "Averages the orientations of all key images where two were compared for the first time.",
    "register": "Finds the orientation that agrees with these key images, and makes a new one where the view is new. "
    "In reference images, finds the pose.",
}


@dataclass(frozen=True)
class PanoramaConfig:
    """Settings of the registration to a panorama."""

    features: Literal["sift", "orb"] = "sift"
    """ORB takes a third of the time; its places are less exact."""
    max_features: Annotated[int, Range(100, 3000)] = 600
    """Features of an image."""
    max_error_px: Annotated[float, Range(0.3, 20)] = 2.0
    """Largest distance of an inlier in the middle of the image [px]."""
    min_inliers: Annotated[int, Range(8, 500)] = 20
    """Least number of matches that agree with one rotation; with fewer a frame is not registered."""
    key_angle: Annotated[float, Range(0.05, 0.6)] = 0.25
    """A view farther from all key images than this share of the smaller field of view becomes one."""
    max_key_images: Annotated[int, Range(2, 400)] = 100
    """Most key images of a panorama, and most images that are used of a reference. A full turn with a usual lens has
    30 key images."""
    min_rotation_share: Annotated[float, Range(0.1, 1)] = 0.7
    """Least share of the matches of a rigid motion that a rotation must explain; with less the camera translates."""
    max_gap_deg: Annotated[float, Range(0.05, 45)] = 2.0
    """Largest gap [degrees] with which a full turn closes; a larger one shows a wrong focal length."""
    max_lost_frames: Annotated[int, Range(1, 1000)] = 30
    """Frames that may fail before a new panorama begins at the last orientation."""

    reference: Annotated[str, NamesFile()] = ""
    """Folder of images captured before, with their poses and camera, in which each frame is found; empty: none. Its
    world and its unit are those of the poses."""

    def build(self, rig: Rig) -> Panorama | Registration:
        config = checked(self)
        if not config.reference:
            return Panorama(rig, config)
        extraction = Extraction(
            *FEATURES[config.features], config.max_features, config.max_key_images, config.max_error_px
        )
        return Registration(rig, config, read_reference(config.reference, extraction))


@dataclass(frozen=True, eq=False)
class KeyImage:
    """A part of the panorama."""

    view: View
    first_id: int
    """Id of its first feature; the others have the ids that follow."""
    rotation: Array
    """(3, 3) world_from_camera."""
    rgb: NDArray[np.uint8]
    """(N, 3) of its features."""


@dataclass(frozen=True, eq=False)
class Memory:
    """The panorama, and the orientations so far."""

    key_images: tuple[KeyImage, ...] = ()
    comparisons: tuple[Edge, ...] = ()
    frames: PersistentList[tuple[int, int, Array]] = PersistentList()
    """(time_ns, number of a key image, key_from_camera) of the frames of this panorama."""
    ended: PersistentList[tuple[int, Pose]] = PersistentList()
    """(time_ns, world_from_camera) of the frames of earlier panoramas."""
    time_ns: int = 0
    rotation: Array = field(default_factory=lambda: np.eye(3))
    """(3, 3) world_from_camera of the last registered frame."""
    rate: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) rotation per second, on its right [rad/s]."""
    next_id: int = 0
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(M,) of the last frame's inliers, ascending."""
    uv: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(M, 2)."""
    lost: int = 0
    found: Pose | None = None
    """world_from_camera of the last frame that was found in reference images."""

    def trajectory(self) -> list[tuple[int, Pose]]:
        """Returns (time_ns, world_from_camera) of all frames, as the panorama is now."""
        now = [(t, oriented(self.key_images[k].rotation @ relative)) for t, k, relative in self.frames]
        return [*self.ended, *now]


@dataclass(frozen=True, eq=False)
class Comparison:
    """The rotation of a frame relative to a key image."""

    number: int
    """Of the key image."""
    pairs: NDArray[np.int64]
    """(M, 2) matches: features of the frame, and of the key image."""
    rotation: Array
    """(3, 3) key_from_camera."""
    inliers: NDArray[np.bool_]
    """(M,)."""


class _Registering(OneKind[Memory]):
    """Registers each frame to images taken before."""

    kind, frame = "video", "video"

    def __init__(self, rig: Rig, config: PanoramaConfig) -> None:
        self.rig, self.config, self.camera = rig, config, rig.camera("video")
        self.descriptor, self.matcher = FEATURES[config.features]
        self.limit = config.max_error_px / self.camera.fx

    def begin(self) -> Memory:
        """See OneKind."""
        return Memory()


class Panorama(_Registering):
    """Gives each frame an orientation. World: the camera at the first frame; the position stays there."""

    def finish(self, state: State[Any], /) -> Trajectory:
        """See Estimator: with the orientations of the key images as averaged last."""
        return Trajectory.of(state.memory.trajectory(), "video")

    def process(self, memory: Memory, frame: Frame, watch: Stopwatch) -> tuple[Memory, Result]:
        """See OneKind: one frame."""
        view = View.of(as_grey(frame.image), self.camera, self.descriptor, self.config.max_features)
        watch.lap("features")
        if not memory.key_images:
            return self._begun(memory, frame, view, ())
        seconds = (frame.time_ns - memory.time_ns) * 1e-9
        predicted = memory.rotation @ so3_exp(seconds * memory.rate)
        compared = self._compared(memory, view, predicted)
        watch.lap("compare")
        memory, closed, changed = self._closed(memory, compared)
        watch.lap("average")

        rotation, registered = self._registered(memory, view, compared)
        located = INLIERS.of(len(registered[0]), self.config.min_inliers)
        decisions = (located, *(self._rotation_only(memory, view, compared[0]) if located.passed else ()), *closed)
        if not located.passed:
            watch.lap("register")
            if memory.lost < self.config.max_lost_frames:
                return replace(memory, lost=memory.lost + 1), Result(decisions=decisions)
            return self._begun(memory, frame, view, decisions)

        ids, uv, errors = registered
        before = np.full((len(ids), 2), np.nan, np.float32)
        _, here, there = np.intersect1d(ids, memory.ids, return_indices=True)
        before[here] = memory.uv[there]
        rate = so3_log(memory.rotation.T @ rotation) / seconds
        best = compared[0].number
        relative = memory.key_images[best].rotation.T @ rotation
        after = replace(
            memory, frames=memory.frames.appended((frame.time_ns, best, relative)), time_ns=frame.time_ns,
            rotation=rotation, rate=rate, ids=ids, uv=uv, lost=0,
        )  # fmt: skip
        after, is_key, new_view = self._extended(after, frame, view, compared)
        watch.lap("register")
        shown = after.key_images if changed else after.key_images[len(memory.key_images) :]
        return after, Result(
            oriented(rotation), (*decisions, new_view), {"video": tracks_between(ids, uv, before)}, _landmarks(shown),
            self.camera.fx * errors, key_frame=is_key,
            revised=Trajectory.of(after.trajectory()[:-1], "video") if changed else Trajectory.empty("video"),
        )  # fmt: skip

    @cached_property
    def _key_angle_rad(self) -> float:
        """The angle between key images."""
        side = min(self.camera.width, self.camera.height)
        return self.config.key_angle * 2 * float(np.arctan(0.5 * side / self.camera.fx))

    def _begun(
        self, memory: Memory, frame: Frame, view: View, decisions: tuple[Decision, ...]
    ) -> tuple[Memory, Result]:
        """Begins a panorama: the first one, or after a loss a new one at the last orientation."""
        enough = FEATURE_COUNT.of(len(view.rays), self.config.min_inliers)
        decisions = (*decisions, enough)
        if not enough.passed:
            return memory, Result(decisions=decisions)
        ended, frames = PersistentList[tuple[int, Pose]](), PersistentList[tuple[int, int, Array]]()
        empty = Memory(
            ended=ended.extended(memory.trajectory()), frames=frames.appended((frame.time_ns, 0, np.eye(3))),
            time_ns=frame.time_ns, rotation=memory.rotation, next_id=memory.next_id,
        )  # fmt: skip
        after = self._with_key_image(empty, frame, view, ())
        key = after.key_images[0]
        ids = key.first_id + np.arange(len(view.rays))
        after = replace(after, ids=ids, uv=view.features.uv)
        return after, Result(
            oriented(after.rotation), decisions, {"video": tracks_between(ids, view.features.uv)},
            _landmarks(after.key_images), key_frame=True, restarted=bool(memory.key_images or len(memory.ended)),
        )  # fmt: skip

    # Step 1

    def _compared(self, memory: Memory, view: View, predicted: Array) -> list[Comparison]:
        """Returns how the frame lies to the nearest key images, or to all where it agrees with none of these; the one
        with most inliers first."""
        axes = np.stack([key.rotation[:, 2] for key in memory.key_images])
        order = np.argsort(-(axes @ predicted[:, 2]), kind="stable")
        found = list[Comparison]()
        for some in (order[:COMPARED], order[COMPARED:]):
            found += [c for n in some if (c := self._comparison(memory, view, int(n))) is not None]
            if any(c.inliers.sum() >= self.config.min_inliers for c in found):
                break
        return sorted(found, key=lambda c: -int(c.inliers.sum()))

    def _comparison(self, memory: Memory, view: View, number: int) -> Comparison | None:
        key = memory.key_images[number].view
        pairs = self.matcher.match(view.features, key.features)
        if len(pairs) < 3:
            return None
        rotation, inliers = rotation_between_rays(view.rays[pairs[:, 0]], key.rays[pairs[:, 1]], self.limit)
        return Comparison(number, pairs, rotation, inliers)

    # Step 3

    def _closed(self, memory: Memory, compared: list[Comparison]) -> tuple[Memory, tuple[Decision, ...], bool]:
        """Returns the memory with all key images compared that this frame sees and that were not yet; with orientations
        averaged if there were any. Also whether orientations changed."""
        good = [c for c in compared if c.inliers.sum() >= self.config.min_inliers]
        known, gaps, new = {(e.first, e.then) for e in memory.comparisons}, list[float](), list[Edge]()
        for a, b in combinations(sorted(good, key=lambda c: c.number), 2):
            if (a.number, b.number) in known:
                continue
            first, then = memory.key_images[a.number], memory.key_images[b.number]
            measured = a.rotation @ b.rotation.T
            if b.number - a.number > COMPARED:
                gaps.append(float(np.degrees(rotation_angle_rad(measured.T @ first.rotation.T @ then.rotation))))
            new.append(self._edge(a.number, b.number, measured, min(int(c.inliers.sum()) for c in (a, b)) / 2))
        if not new:
            return memory, (), False
        edges = (*memory.comparisons, *new)
        nodes = tuple(Similarity(1.0, oriented(key.rotation)) for key in memory.key_images)
        averaged = optimise(nodes, edges, scaled=False).nodes
        keys = tuple(
            replace(key, rotation=oriented(node.pose.rotation).rotation)
            for key, node in zip(memory.key_images, averaged, strict=True)
        )
        memory = replace(memory, key_images=keys, comparisons=edges)
        return memory, tuple(CLOSED.of(max(gaps), self.config.max_gap_deg) for _ in gaps[:1]), True

    def _edge(self, first: int, then: int, rotation: Array, count: float, sure: bool = False) -> Edge:
        """Returns the comparison of two key images; it may be false unless it is `sure`."""
        sigma = NOISE_PX / self.camera.fx / np.sqrt(count)
        # Along the axis a rotation moves features by their distance from the middle only, about a third of the others.
        covariance = np.diag([1e-6] * 3 + [sigma**2, sigma**2, 9 * sigma**2] + [1e-6])
        return Edge(first, then, Similarity(1.0, oriented(rotation)), covariance, not sure)

    # Step 4

    def _registered(
        self, memory: Memory, view: View, compared: list[Comparison]
    ) -> tuple[Array, tuple[NDArray[np.int64], NDArray[np.float32], Array]]:
        """Returns world_from_camera, and of its inliers ids (M,), ascending, positions (M, 2) [px] and errors (M,)."""
        nothing = np.zeros(0, np.int64), np.zeros((0, 2), np.float32), np.zeros(0)
        good = [c for c in compared if c.inliers.sum() >= self.config.min_inliers]
        if not good:
            return memory.rotation, nothing
        keys = [memory.key_images[c.number] for c in good]
        own = np.concatenate([c.pairs[c.inliers, 0] for c in good])
        ids = np.concatenate([k.first_id + c.pairs[c.inliers, 1] for k, c in zip(keys, good, strict=True)])
        world = [k.view.rays[c.pairs[c.inliers, 1]] @ k.rotation.T for k, c in zip(keys, good, strict=True)]
        start = keys[0].rotation @ good[0].rotation
        rotation, errors = least_squares_rotation(view.rays[own], np.concatenate(world), start, self.limit / 2)
        inliers = np.flatnonzero(errors <= self.limit)
        inliers = inliers[np.argsort(ids[inliers], kind="stable")]
        return rotation, (ids[inliers], view.features.uv[own[inliers]], errors[inliers])

    def _extended(
        self, memory: Memory, frame: Frame, view: View, compared: list[Comparison]
    ) -> tuple[Memory, bool, Decision]:
        """Returns the memory with the frame as a key image, where its view is new and there is room."""
        cosines = np.array([key.rotation[:, 2] @ memory.rotation[:, 2] for key in memory.key_images])
        nearest = float(np.degrees(np.arccos(np.clip(cosines.max(), -1, 1))))
        full = len(memory.key_images) >= self.config.max_key_images
        new_view = NEW_VIEW.of(nearest, np.degrees(self._key_angle_rad))
        if full:
            new_view = replace(new_view, passed=False, consequence="the panorama is full")
        if not new_view.passed:
            return memory, False, new_view
        return self._with_key_image(memory, frame, view, compared), True, new_view

    def _with_key_image(self, memory: Memory, frame: Frame, view: View, compared: Any) -> Memory:
        number = len(memory.key_images)
        key = KeyImage(view, memory.next_id, memory.rotation, colours_at(frame.image, view.features.uv))
        edges = [
            self._edge(c.number, number, c.rotation, int(c.inliers.sum()), sure=i == 0)
            for i, c in enumerate(compared) if c.inliers.sum() >= self.config.min_inliers
        ]  # fmt: skip
        return replace(
            memory, key_images=(*memory.key_images, key), comparisons=(*memory.comparisons, *edges),
            next_id=memory.next_id + len(view.rays),
        )  # fmt: skip

    # Step 5

    def _rotation_only(self, memory: Memory, view: View, best: Comparison) -> tuple[Decision, ...]:
        """Compares the inliers of the rotation with those of a rotation and a translation."""
        rays = view.rays[best.pairs[:, 0]], memory.key_images[best.number].view.rays[best.pairs[:, 1]]
        ahead = (rays[0][:, 2] > 0.1) & (rays[1][:, 2] > 0.1)
        x1, x2 = (r[ahead, :2] / r[ahead, 2:] for r in rays)
        own = int(best.inliers[ahead].sum())
        count = max(own, 1, rigid_matches(x1, x2, self.limit))
        share = ROTATION.of(own / count, self.config.min_rotation_share)
        if share.passed:
            return (share,)
        counts = [
            rotation_between_rays(_unit(x1 / factor), _unit(x2 / factor), self.limit / factor)[1].sum()
            for factor in FOCAL_FACTORS
        ]
        most = int(np.argmax(counts))
        explained = bool(counts[most] >= self.config.min_rotation_share * count)
        return share, FOCAL.of(FOCAL_FACTORS[most], 1.0, passed=explained)


def rigid_matches(x1: Array, x2: Array, limit: float) -> int:
    """Returns how many matches (N, 2) of normalised coordinates agree with one epipolar geometry.

    A fundamental matrix holds for each rigid motion, rotations included, and whatever the focal length is.
    """
    if len(x1) < 8:
        return 0
    scaled = inlier_distances(x1, limit), inlier_distances(x2, limit)
    _, inliers = cv2.findFundamentalMat(*scaled, cv2.FM_RANSAC, 1.0, 0.999, RIGID_SAMPLES)
    return 0 if inliers is None else int(inliers.sum())


class Registration(_Registering):
    """Finds each frame in reference images. World: that of the reference."""

    def __init__(self, rig: Rig, config: PanoramaConfig, reference: Reference) -> None:
        super().__init__(rig, config)
        self.reference = reference

    def finish(self, state: State[Any], /) -> Trajectory:
        """See Estimator."""
        return Trajectory.of(state.memory.trajectory(), "video")

    def process(self, memory: Memory, frame: Frame, watch: Stopwatch) -> tuple[Memory, Result]:
        """See OneKind: one frame."""
        grey = as_grey(frame.image)
        view = View.of(grey, self.camera, self.descriptor, self.config.max_features).ahead()
        watch.lap("features")
        if memory.key_images:  # the run went on from a panorama of its own
            frames = memory.trajectory()[len(memory.ended) :]
            memory = Memory(ended=memory.ended.extended(frames), next_id=memory.next_id)
        found, decisions = None, ()
        for numbers in self._candidates(memory, grey):
            matches = self._matches(view, numbers)
            watch.lap("compare")
            found, decisions = self._located(view, matches, memory.found)
            watch.lap("register")
            if found is not None:
                break
        if found is None:
            return replace(memory, lost=memory.lost + 1), Result(decisions=decisions)
        ids, uv = found.ids, view.features.uv[found.own]
        before = np.full((len(ids), 2), np.nan, np.float32)
        _, here, there = np.intersect1d(ids, memory.ids, return_indices=True)
        before[here] = memory.uv[there]
        pose = found.world_from_camera
        after = replace(
            memory, ended=memory.ended.appended((frame.time_ns, pose)), time_ns=frame.time_ns, rotation=pose.rotation,
            ids=ids, uv=uv, lost=0, found=pose,
        )  # fmt: skip
        return after, Result(
            pose, decisions, {"video": tracks_between(ids, uv, before)},
            self.reference.landmarks() if memory.found is None else Landmarks.empty(), self.camera.fx * found.errors,
            restarted=memory.found is None and len(memory.ended) > 0,
        )  # fmt: skip

    def _candidates(self, memory: Memory, grey: Image) -> Iterator[list[int]]:
        """Yields numbers of reference images to compare: those near the last pose, then those that look most similar.

        Each further lost frame is compared with the next similar ones, so that the time of a frame is bounded.
        """
        if memory.found is not None:
            yield self.reference.nearest(memory.found)[:COMPARED]
        order = self.reference.most_similar(grey)
        yield [order[(COMPARED * memory.lost + n) % len(order)] for n in range(min(COMPARED, len(order)))]

    def _matches(self, view: View, numbers: list[int]) -> Matches:
        """Returns the matches of the frame with these reference images that have a point or, in one place, a ray."""
        own, ids = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        targets: list[Array] = [np.zeros((0, 3))]
        counts = list[int]()
        for image in (self.reference.images[n] for n in numbers):
            pairs = self.matcher.match(view.features, image.view.features)
            at = image.view.rays @ image.world_from_camera.rotation.T if self.reference.one_place else image.xyz
            pairs = pairs[np.isfinite(at[pairs[:, 1], 0])]
            own, ids = [*own, pairs[:, 0]], [*ids, image.first_id + pairs[:, 1]]
            targets.append(at[pairs[:, 1]])
            counts.append(len(pairs))
        image_of = np.repeat(np.arange(len(counts)), counts)
        return Matches(np.concatenate(own), np.concatenate(ids), np.concatenate(targets), image_of)

    def _located(self, view: View, matches: Matches, last: Pose | None) -> tuple[Located | None, tuple[Decision, ...]]:
        """Returns the pose on which the matches agree, None where too few do, and the checks."""
        fitted = (self._turned if self.reference.one_place else self._placed)(view, matches, last)
        count = 0 if fitted is None else len(fitted.ids)
        decisions = (
            REFERENCE_MATCHES.of(count, self.config.min_inliers),
            REFERENCE_SHARE.of(0.0 if fitted is None else matches.share(fitted.image_of), MIN_SHARE),
        )
        return (fitted if all(decision.passed for decision in decisions) else None), decisions

    def _placed(self, view: View, matches: Matches, last: Pose | None) -> Located | None:
        """Returns the pose by points: from the last one, or else by RANSAC."""
        x, policy = view.x[matches.own], Policy(self.limit / 2, self.limit, self.limit)
        if last is None:
            fit = resect(matches.targets, x, self.limit)
        else:
            fit = locate(matches.targets, x, last.inverse(), policy)
        if fit is None:
            return None
        return Located.of(fit.camera_from_world.inverse(), matches, fit.distances, fit.inliers)

    def _turned(self, view: View, matches: Matches, _: Pose | None) -> Located | None:
        """Returns the orientation by directions, at the place of the reference."""
        if len(matches.own) < 3:
            return None
        rays = view.rays[matches.own]
        rotation, inliers = rotation_between_rays(rays, matches.targets, self.limit)
        errors = np.linalg.norm(rays @ rotation.T - matches.targets, axis=1)
        return Located.of(Pose(oriented(rotation).rotation, self.reference.place), matches, errors, inliers)


@dataclass(frozen=True, eq=False)
class Matches:
    """M matches of a frame with reference images."""

    own: NDArray[np.int64]
    """(M,) features of the frame."""
    ids: NDArray[np.int64]
    """(M,) of the reference's features."""
    targets: Array
    """(M, 3) their points or, in one place, their directions, in the world."""
    image_of: NDArray[np.int64]
    """(M,) the reference image of each, numbered among those compared."""

    def share(self, image_of: NDArray[np.int64]) -> float:
        """Returns the share of inliers, whose images are given (K,), among the matches with the image that has most of
        them. Images that show another part of the scene have wrong matches only, which say nothing about the pose."""
        if not len(image_of):
            return 0.0
        counts = np.bincount(image_of)
        return float(counts.max() / (self.image_of == counts.argmax()).sum())


@dataclass(frozen=True, eq=False)
class Located:
    """The pose of a frame in the reference, with its inliers."""

    world_from_camera: Pose
    ids: NDArray[np.int64]
    """(K,) ascending."""
    own: NDArray[np.int64]
    """(K,) features of the frame."""
    errors: Array
    """(K,) normalised."""
    image_of: NDArray[np.int64]
    """(K,) as in Matches."""

    @staticmethod
    def of(pose: Pose, matches: Matches, errors: Array, inliers: NDArray[np.bool_]) -> Located:
        """Returns the pose with the inliers among the matches."""
        some = np.flatnonzero(inliers)
        some = some[np.argsort(matches.ids[some], kind="stable")]
        return Located(pose, matches.ids[some], matches.own[some], errors[some], matches.image_of[some])


# Step 2: the rotation between two sets of rays


def rotation_between_rays(a: Array, b: Array, limit: float) -> tuple[Array, NDArray[np.bool_]]:
    """Returns the rotation (3, 3) b_from_a of unit rays (N, 3) and its inliers (N,): those within `limit` [rad].

    RANSAC over samples of two, each of which gives the rotation that carries the plane of one pair into that of the
    other; then least squares over the inliers. Deterministic.
    """
    first, second = np.random.default_rng(0).integers(0, len(a), (2, SAMPLES))
    rotations = _frames(b[first], b[second]) @ np.swapaxes(_frames(a[first], a[second]), 1, 2)
    distances = np.linalg.norm(np.einsum("sij,nj->sni", rotations, a) - b, axis=2)
    best = int((distances <= limit).sum(axis=1).argmax())
    rotation, inliers = rotations[best], distances[best] <= limit
    if inliers.sum() >= 2:
        rotation, _ = least_squares_rotation(a[inliers], b[inliers], rotation, limit / 2)
        inliers = np.linalg.norm(a @ rotation.T - b, axis=1) <= limit
    return rotation, inliers


def _frames(a: Array, b: Array) -> Array:
    """Returns the axes (S, 3, 3), as columns, that two rays (S, 3) span: between them, across, and normal to both."""
    middle, across = a + b, b - a
    across = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    middle = middle / np.maximum(np.linalg.norm(middle, axis=1, keepdims=True), 1e-12)
    return np.stack([middle, across, np.cross(middle, across)], axis=2)


def least_squares_rotation(a: Array, b: Array, start: Array, width: float) -> tuple[Array, Array]:
    """Returns the rotation (3, 3) b_from_a of unit rays (N, 3), and distances (N,): Kabsch, with robust weights."""
    rotation = start
    for _ in range(ITERATIONS):
        weights = robust_weights(((a @ rotation.T - b) ** 2).sum(axis=1), width)
        u, _, vt = np.linalg.svd((weights[:, None] * b).T @ a)
        rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return rotation, np.linalg.norm(a @ rotation.T - b, axis=1)


def _unit(x: Array) -> Array:
    """Returns unit rays (N, 3) of normalised coordinates (N, 2)."""
    rays = np.column_stack([x, np.ones(len(x))])
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def oriented(rotation: Array) -> Pose:
    """Returns the pose of the camera at the origin; exactly a rotation, as products of many are not."""
    return Pose.from_xyzw(Pose(rotation).xyzw, np.zeros(3))


def _landmarks(keys: tuple[KeyImage, ...]) -> Landmarks:
    """Returns the features of key images as points of the unit sphere: the panorama in the 3-D view."""
    if not keys:
        return Landmarks.empty()
    ids = np.concatenate([key.first_id + np.arange(len(key.rgb)) for key in keys])
    xyz = np.concatenate([key.view.rays @ key.rotation.T for key in keys])
    return Landmarks(ids, xyz, np.concatenate([key.rgb for key in keys]))


METHOD = Method(
    "panorama", VIDEO, PanoramaConfig, "own", "Kourogi et al. 1999; Brown and Lowe 2007",
    checks=CHECKS, stages=STAGES, survey="Table 3, one camera: registration",
)  # fmt: skip
