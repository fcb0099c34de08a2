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
4. The frame is registered to all key images near it at once; where it sees much that none of them has, it is the next.
5. A check compares the matches that one rotation explains with those that a rotation and a translation do. Where it
   fails, it is tried whether another focal length would make it a rotation.

Limits. The position is that of the first frame, always: where the camera moves by more than about a hundredth of the
distance of what it sees, a rotation is no longer the truth, and the check `rotation_only` fails. What moves in the
scene must be the smaller part. A wrong focal length makes a turn close with a gap, which the averaging only spreads.

Measured: sim:city?motion=pan, every 20th video frame of a turn and back: orientations within 0.06 degrees of the truth
(largest; ORB: 0.14). A film of a roller coaster by a panning telephone without calibration, 70 frames: all registered,
and the check names a focal length 1.6 times the guess; with that, a rotation explains 75 to 98 % of the rigid matches.
In the moving flight of sim:city, `rotation_only` fails at each frame until the panorama is lost.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from typing import Annotated, Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.estimator import VIDEO, Method
from ispom.estimators.survey.common import OneKind, Result, State, tracks_between
from ispom.features.interfaces import Features
from ispom.features.orb import ORB, ORB_MATCHER
from ispom.features.sift import SIFT, SIFT_MATCHER
from ispom.geometry import Array, Pose, Similarity, rotation_angle_rad, so3_exp, so3_log
from ispom.numerics.robust import robust_weights
from ispom.persistent_list import PersistentList
from ispom.settings import Range, checked
from ispom.solvers.multiview.essential import inlier_distances
from ispom.solvers.pose_graph import Edge, optimise
from ispom.stopwatch import Stopwatch
from ispom.types import Check, Decision, Frame, Image, Landmarks, Rig, Trajectory, as_grey, by_key, colours_at

FEATURES = {"sift": (SIFT, SIFT_MATCHER), "orb": (ORB, ORB_MATCHER)}
COMPARED = 4
"""Key images that a frame is compared with: those whose axes are nearest to the predicted one."""
SAMPLES = 200
"""Of two matches; where 25 % of them are right, 200 samples hold a right one at 99.99 %."""
ITERATIONS = 6
"""Of weighted least squares, each with new weights."""
RIGID_SAMPLES = 300
"""Of seven matches, for the check `rotation_only`: a failure of the sampling makes the check pass, not fail."""
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
CHECKS = by_key(FEATURE_COUNT, INLIERS, ROTATION, FOCAL, NEW_VIEW, CLOSED)
STAGES = {
    "features": "Detects and describes the features of the frame.",
    "compare": "Matches them to the nearest key images, and finds the rotation to each.",
    "average": "Averages the orientations of all key images where two were compared for the first time.",
    "register": "Finds the orientation that agrees with these key images, and makes a new one where the view is new.",
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
    """With fewer matches that agree with one rotation a frame is not registered."""
    key_angle: Annotated[float, Range(0.05, 0.6)] = 0.25
    """A view farther from all key images than this share of the smaller field of view becomes one."""
    max_key_images: Annotated[int, Range(2, 400)] = 100
    """The panorama grows no further; a full turn with a usual lens has 30."""
    min_rotation_share: Annotated[float, Range(0.1, 1)] = 0.7
    """Share of the matches of a rigid motion that a rotation must explain, or the camera is said to translate."""
    max_gap_deg: Annotated[float, Range(0.05, 45)] = 2.0
    """A turn that closes with a larger gap [degrees] tells of a wrong focal length."""
    max_lost_frames: Annotated[int, Range(1, 1000)] = 30
    """Frames that may fail before a new panorama begins at the last orientation."""

    def build(self, rig: Rig) -> Panorama:
        return Panorama(rig, checked(self))


@dataclass(frozen=True, eq=False)
class View:
    """Features of an image, with rays."""

    features: Features
    rays: Array
    """(N, 3) unit vectors in the camera."""


@dataclass(frozen=True, eq=False)
class KeyImage:
    """A part of the panorama."""

    view: View
    first_id: int
    """Of its features, which have the ids from it on."""
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

    def trajectory(self) -> list[tuple[int, Pose]]:
        """Returns (time_ns, world_from_camera) of all frames, as the panorama is now."""
        now = [(t, oriented(self.key_images[k].rotation @ relative)) for t, k, relative in self.frames]
        return [*self.ended, *now]


@dataclass(frozen=True, eq=False)
class Comparison:
    """How a frame lies to a key image."""

    number: int
    """Of the key image."""
    pairs: NDArray[np.int64]
    """(M, 2) matches: features of the frame, and of the key image."""
    rotation: Array
    """(3, 3) key_from_camera."""
    inliers: NDArray[np.bool_]
    """(M,)."""


class Panorama(OneKind[Memory]):
    """Gives each frame an orientation. World: the camera at the first frame; the position stays there."""

    kind, frame = "video", "video"

    def __init__(self, rig: Rig, config: PanoramaConfig) -> None:
        self.rig, self.config, self.camera = rig, config, rig.camera("video")
        self.descriptor, self.matcher = FEATURES[config.features]
        self.limit = config.max_error_px / self.camera.fx

    def begin(self) -> Memory:
        """See OneKind."""
        return Memory()

    def finish(self, state: State[Any], /) -> Trajectory:
        """See Estimator: with the orientations of the key images as averaged last."""
        return Trajectory.of(state.memory.trajectory(), "video")

    def process(self, memory: Memory, frame: Frame, watch: Stopwatch) -> tuple[Memory, Result]:
        """See OneKind: one frame."""
        view = self._view(as_grey(frame.image))
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
            _landmarks(after.key_images), key_frame=True, restarted=bool(memory.key_images),
        )  # fmt: skip

    # Step 1

    def _view(self, grey: Image) -> View:
        features = self.descriptor.detect_and_describe(grey, self.config.max_features).compact()
        features = features[np.arange(min(len(features), self.config.max_features))]
        rays, valid = self.camera.unproject(features.uv.astype(float))
        return View(features[valid], rays[valid])

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
