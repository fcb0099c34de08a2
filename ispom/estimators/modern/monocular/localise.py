"""Locating a frame in the map: pose from the points seen, tracks set right by it, then the pose again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.lens import Lens, corrected
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.realign import realigned
from ispom.estimators.modern.monocular.setup import INLIER, WIDTH, Setup
from ispom.estimators.modern.monocular.state import NewImage
from ispom.estimators.modern.monocular.tracks import (
    Followed,
    LiveTracks,
    displaced_by_features,
    follow,
    projected,
    unrolled,
)
from ispom.estimators.modern.monocular.untriangulated import UntriangulatedTracks, with_untriangulated
from ispom.estimators.modern.rolling import late_px
from ispom.estimators.tracked_frame import TrackedFrame
from ispom.geometry import Array, Pose
from ispom.numerics.places import common
from ispom.numerics.reductions import lengths
from ispom.solvers.localisation import Policy, PoseFit, fit_pose, locate
from ispom.solvers.multiview.rotation import rotate
from ispom.types import TrackStatus

MIN_LOCATED = 15
"""Fewer points that agree with a pose are a loss: a pose has 6 unknowns, and with two equations a point so many leave
it determined four times over where a third of them is wrong alike."""
MOST = 0.5
"""Of the points tracked: where fewer agree with a pose the camera has jumped. They may lie on one thing that moves, or
at one side of the image, and are compared with what descriptors show."""
SURE = 2 * MIN_LOCATED
"""So many must agree with a pose that descriptors alone find, as nothing foretold it: fewer may agree by chance, or lie
close together on one thing. By fewer, poses were up to 0.4 m off, and what was seen next was placed by them."""
TOO_FAR = 2.0
"""Times the error of tracks by their own pose, at which another pose is none for them. Right ones leave 1.0 to 1.3
times as much; one by 54 points that descriptors placed wrongly left 4.6 times as much to 46 tracks that all agreed:
it took a 14th of the true step, and with it the unit."""


@dataclass(frozen=True, eq=False)
class Localisation:
    """A frame located in the map."""

    followed: Followed
    compared: NDArray[np.bool_]
    """Which tracks were found by the patch of their origin."""
    motion: PoseFit | None
    ids: NDArray[np.int64]
    """(N,) ascending, of the points seen."""
    xyz: Array
    """(N, 3)."""
    seen: Array
    """(N, 2) where, normalised and corrected."""
    untriangulated: UntriangulatedTracks | None = None
    """What tracks without a point say of the pose as well."""

    @property
    def count(self) -> int:
        """Points that agree with one pose."""
        return 0 if self.motion is None else int(self.motion.inliers.sum())

    @property
    def agreeing(self) -> bool:
        """Whether they are enough."""
        return self.count >= MIN_LOCATED

    def error_of(self, camera_from_world: Pose) -> float:
        """Root mean square distance, normalised, that a pose leaves to the points that agree here."""
        assert self.motion is not None
        near = camera_from_world.apply(self.xyz[self.motion.inliers])
        off = near[:, :2] / near[:, 2:] - self.seen[self.motion.inliers]
        return float(np.sqrt((off**2).sum(axis=1).mean()))


def localise(setup: Setup, live: LiveTracks, world: Map, new: NewImage) -> Localisation:
    """From the tracks as followed; where that fails, from tracks displaced as the image's features are."""
    found = _located(setup, live, world, new, new.followed)
    if not found.agreeing and (jumped := displaced_by_features(setup.front_end, live, new.grey)) is not None:
        followed = follow(setup.front_end, setup.camera, live, new.time_ns, new.grey, jumped)
        found = _located(setup, live, world, new, followed)
    return found


def _located(setup: Setup, live: LiveTracks, world: Map, new: NewImage, followed: Followed) -> Localisation:
    """The pose that the tracks give once their patches of origin are found again."""
    assert new.predicted is not None
    places = world.known(live.ids)
    _, xyz, x = _seen(setup, live, world, followed, places)
    limit, compared = INLIER * setup.noise.width, np.zeros(len(followed.status), bool)
    motion = locate(xyz, x, new.predicted.inverse(), Policy(WIDTH * setup.noise.width, limit, limit))
    if motion is not None:
        pose = motion.camera_from_world.inverse()
        followed, compared = set_right(setup, live, world, new, followed, pose, places)
        found = located_by(setup, live, world, followed, pose, places, new.predicted)
        return replace(found, compared=compared)
    ids, xyz, x = _seen(setup, live, world, followed, places)
    return Localisation(followed, compared, None, ids, xyz, x)


def located_by(
    setup: Setup,
    live: LiveTracks,
    world: Map,
    followed: Followed,
    world_from_guess: Pose,
    places: Array | None = None,
    predicted: Pose | None = None,
) -> Localisation:
    """The pose that these tracks give, from a good guess. `places` (N, 3) as `Map.known` of them, where it is there;
    `predicted` where the motion before leads, if that is another one."""
    places = world.known(live.ids) if places is None else places
    ids, xyz, x = _seen(setup, live, world, followed, places)
    limit = INLIER * setup.noise.width
    motion, untriangulated = fit_pose(xyz, x, world_from_guess.inverse(), WIDTH * setup.noise.width, limit), None
    if motion is not None:
        motion, untriangulated = with_untriangulated(
            setup, live, world, followed, places, motion, (xyz, x), world_from_guess if predicted is None else predicted
        )
    return Localisation(followed, np.zeros(len(followed.status), bool), motion, ids, xyz, x, untriangulated)


def _seen(
    setup: Setup, live: LiveTracks, world: Map, followed: Followed, places: Array
) -> tuple[NDArray[np.int64], Array, Array]:
    """Points of the map (N,), (N, 3), and where they are seen (N, 2), normalised and corrected."""
    some = np.flatnonzero((followed.status == TrackStatus.ALIVE) & np.isfinite(places[:, 0]))
    x = corrected(setup.camera.normalise(unrolled(setup.camera, followed)[some]), world.extra)
    return live.ids[some], places[some], x


def set_right(
    setup: Setup, live: LiveTracks, world: Map, new: NewImage, followed: Followed, pose: Pose, places: Array
) -> tuple[Followed, NDArray[np.bool_]]:
    """Points of the map, at (N, 3), that tracking lost or misplaced are looked for where the pose puts them."""
    lens = Lens(setup.camera, world.extra)
    late = late_px(setup.camera, followed.uv, followed.speed)
    expected = projected(lens, places, pose, followed.uv - late) + late
    misplaced = lengths(expected - followed.uv) > INLIER * setup.noise_px.width
    lost = followed.status != TrackStatus.ALIVE
    expected = np.where((misplaced | lost)[:, None], expected, followed.uv)
    origins = {k.time_ns: p for k, p in zip(world.keys, world.poses, strict=True)}
    return realigned(lens, live, new.grey, followed, expected, new.scene, pose, origins)


def contradicted(setup: Setup, live: LiveTracks, world: Map, found: Localisation, again: Localisation) -> bool:
    """Whether a pose that descriptors gave, `again`, is none for the tracks, most of which agree with `found` where
    that leaves them in sight: others went out of the image as it turned, and say nothing against it."""
    if found.motion is None or again.motion is None or not found.agreeing:
        return False
    near = found.motion.camera_from_world.apply(world.known(live.ids))
    near = near[np.isfinite(near[:, 0])]
    shown = Lens(setup.camera, world.extra).in_image(near)
    if found.count < MOST * np.isfinite(shown[:, 0]).sum():
        return False
    return found.error_of(again.motion.camera_from_world) > TOO_FAR * found.error_of(found.motion.camera_from_world)


def moving_tracks(key: TrackedFrame, frame: TrackedFrame, ids: NDArray[np.int64], limit: float) -> NDArray[np.int64]:
    """Those of the tracks `ids` (M,) ascending, where both frames have them, that are no images of a still point.

    They are farther than `limit` (normalised) from their epipolar line, which begins where an infinitely far point is.
    """
    assert key.world_from_camera is not None and frame.world_from_camera is not None
    ids = ids[common(ids, key.ids)[0]]
    motion = frame.world_from_camera.inverse() @ key.world_from_camera
    far = rotate(motion.rotation, key.at(ids))
    line = motion.translation[:2] - far * motion.translation[2]
    line /= np.maximum(lengths(line), 1e-12)[:, None]
    moved = frame.at(ids) - far
    along = np.maximum(moved[:, 0] * line[:, 0] + moved[:, 1] * line[:, 1], 0.0)[:, None]
    return ids[lengths(moved - along * line) > limit]
