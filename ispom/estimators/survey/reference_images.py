"""Images with known poses, captured beforehand, in which `panorama` finds each frame: the map of its localisation.

The features of every reference image are matched to those of its neighbours. Matches that agree with the known poses
are intersected to points of the reference's world. Where all images are from one place (a panorama), there is no
parallax, and each feature has a direction only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.estimators.modern.keyframe_database import appearance_of, ranked
from ispom.features.interfaces import Descriptor, Features, Matcher
from ispom.geometry import Array, Pose
from ispom.io.files import confined, expanded, inside, is_folder
from ispom.numerics.robust import Noise
from ispom.sequences import open_sequence
from ispom.solvers.multiview.essential import sampson_distance
from ispom.solvers.multiview.inverse_depth import intersect
from ispom.types import Camera, Frame, FrameName, Image, Landmarks, Sequence, as_grey, colours_at

MIN_IMAGES = 2
"""Least number of reference images with a pose: one has no parallax, and its direction alone is no map."""
NEIGHBOURS = (0, 1, 3, 6, 10)
"""Ranks, by distance, of the images with which an image is matched: near ones match well, far ones have parallax."""
SAME_VIEW_COSINE = np.cos(np.radians(50.0))
"""Least cosine between the axes of two images that are matched: descriptors hardly match over more."""
MIN_SIGNIFICANCE = 5.0
"""Least ratio of a point's inverse depth to its standard deviation. Such a point has an error of at most about 1 px in
a frame that is as far from the reference image as its neighbours are."""
NOISE_PX = 1.0
"""Standard deviation of the position of a feature [px]."""
MIN_FIT = 0.3
"""Least share of matches that agree with the poses: right poses explain most matches, wrong ones those that are on
the epipolar lines by chance, which are a few percent."""
MIN_MATCHES = 30
"""Fewer matches in all are too few for this share."""
ONE_PLACE = 1e-9
"""Images whose positions differ by less (in the reference's unit) are from one place. A run of `panorama` has exactly
the same position in all poses; a camera that moves never has."""
AHEAD = 0.1
"""Least component of a unit ray along the axis: with less, normalised coordinates are of no use."""


@dataclass(frozen=True, eq=False)
class View:
    """Features of an image, with rays."""

    features: Features
    rays: Array
    """(N, 3) unit vectors in the camera."""

    @staticmethod
    def of(grey: Image, camera: Camera, descriptor: Descriptor, most: int) -> View:
        """Returns at most `most` features of an image, without those that have no ray."""
        features = descriptor.detect_and_describe(grey, most).compact()
        features = features[np.arange(min(len(features), most))]
        rays, valid = camera.unproject(features.uv.astype(float))
        return View(features[valid], rays[valid])

    def ahead(self) -> View:
        """Returns only the features whose rays have normalised coordinates."""
        some = self.rays[:, 2] > AHEAD
        return View(self.features[some], self.rays[some])

    @property
    def x(self) -> Array:
        """(N, 2) normalised coordinates, of features `ahead`."""
        return self.rays[:, :2] / self.rays[:, 2:]


@dataclass(frozen=True, eq=False)
class ReferenceImage:
    """One image of the reference."""

    view: View
    world_from_camera: Pose
    xyz: Array
    """(N, 3) in the reference's world, of its features; NaN where the distance is unknown."""
    first_id: int
    """Of its features, which have the ids from it on."""
    rgb: NDArray[np.uint8]
    """(N, 3)."""
    appearance: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Reference:
    """The images of a reference, in its own world and unit."""

    images: tuple[ReferenceImage, ...]
    one_place: bool
    """Whether all images are from one place: then a frame gets an orientation, and the position of that place."""

    @property
    def place(self) -> Array:
        """(3,) position of the first image."""
        return self.images[0].world_from_camera.translation

    def nearest(self, world_from_camera: Pose) -> list[int]:
        """Returns the numbers of the images, the one with the most similar view first: angle between the axes, and
        distance relative to that of the scene."""
        axes = np.stack([image.world_from_camera.rotation[:, 2] for image in self.images])
        places = np.stack([image.world_from_camera.translation for image in self.images])
        angle = np.arccos(np.clip(axes @ world_from_camera.rotation[:, 2], -1, 1))
        away = np.linalg.norm(places - world_from_camera.translation, axis=1)
        return np.argsort(angle + away / self._scene_distance, kind="stable").tolist()

    @property
    def _scene_distance(self) -> float:
        """The median distance of points from their images; 1 without any."""
        distances = [np.linalg.norm(image.xyz - image.world_from_camera.translation, axis=1) for image in self.images]
        known = np.concatenate(distances)
        known = known[np.isfinite(known)]
        return float(np.median(known)) if len(known) else 1.0

    def most_similar(self, grey: Image) -> list[int]:
        """Returns the numbers of the images, the one that looks most like this image first."""
        return ranked(appearance_of(grey), [image.appearance for image in self.images])

    def landmarks(self) -> Landmarks:
        """Returns all points; those of one place at the distance 1 from it."""
        parts = list[tuple[NDArray[np.int64], Array, NDArray[np.uint8]]]()
        for image in self.images:
            pose = image.world_from_camera
            xyz = pose.apply(image.view.rays) if self.one_place else image.xyz
            known = np.isfinite(xyz[:, 0])
            parts.append(((image.first_id + np.arange(len(xyz)))[known], xyz[known], image.rgb[known]))
        ids, xyz, rgb = (np.concatenate(values) for values in zip(*parts, strict=True))
        return Landmarks(ids, xyz, rgb)


@dataclass(frozen=True)
class Extraction:
    """How features of reference images are found and matched."""

    descriptor: Descriptor
    matcher: Matcher
    max_features: int
    max_images: int
    max_error_px: float


def read_reference(folder: str, extraction: Extraction) -> Reference:
    """Reads a folder of images with their poses and camera, in any format of one that the project opens.

    The folder may come from somebody else, so files outside of it that it names or links to are not read. Raises
    InputError where it is no such folder, or its poses do not fit its images.
    """
    path = expanded(folder)
    if not inside(path):
        raise InputError(f"{folder} is outside of the folders that may be read here: give one inside of them")
    if not is_folder(path):
        raise InputError(f"{folder} is no folder of reference images: give one with images, camera and poses")
    with confined((path,)):
        sequence = open_sequence(str(path), sensors="none")
        return reference_of(sequence, extraction, folder)


def reference_of(sequence: Sequence, extraction: Extraction, name: str) -> Reference:
    """Returns the reference of a sequence with poses, thinned evenly to `max_images`. Raises InputError as
    `read_reference`, in which `name` names it."""
    kind, camera_name = _camera_of(sequence, name)
    camera, rig_from_camera = sequence.rig.camera(camera_name), sequence.rig.rig_from(camera_name)
    if sequence.guess is not None:
        raise InputError(f"{name} has no calibration of its camera: add a camera.yaml to the reference images")
    poses = {} if sequence.truth is None else dict(sequence.truth.items())
    listed = [i for i, t in enumerate(sequence.times_ns.tolist()) if sequence.kinds[i] == kind and t in poses]
    if len(listed) < MIN_IMAGES:
        raise InputError(
            f"{name} has {len(listed)} reference images with a pose, {MIN_IMAGES} are needed: add their poses, as "
            "groundtruth.txt"
        )
    rotations = np.stack([poses[int(sequence.times_ns[i])].rotation for i in listed])
    places = np.stack([(poses[int(sequence.times_ns[i])] @ rig_from_camera).translation for i in listed])
    one_place = bool(np.ptp(places, axis=0).max() < ONE_PLACE)
    if not one_place and np.ptp(rotations, axis=0).max() == 0 and np.array_equal(rotations[0], np.eye(3)):
        raise InputError(f"{name} has positions of its images without orientations: give poses with both")
    count = min(len(listed), extraction.max_images)
    chosen = [listed[i] for i in np.linspace(0, len(listed) - 1, count).round().astype(int)]
    views, world_from_camera = list[View](), list[Pose]()
    rgb, appearances = list[NDArray[np.uint8]](), list[NDArray[np.float32]]()
    for i in chosen:
        frame = sequence[i]
        assert isinstance(frame, Frame)
        image = frame.images[camera_name]
        views.append(View.of(as_grey(image), camera, extraction.descriptor, extraction.max_features).ahead())
        world_from_camera.append(poses[frame.time_ns] @ rig_from_camera)
        rgb.append(colours_at(image, views[-1].features.uv))
        appearances.append(appearance_of(as_grey(image)))
    unknown = [np.full((len(view.rays), 3), np.nan) for view in views]
    xyz = unknown if one_place else _points(views, world_from_camera, camera.fx, extraction, name)
    first = np.concatenate([[0], np.cumsum([len(view.rays) for view in views])])
    parts = zip(views, world_from_camera, xyz, first[:-1].tolist(), rgb, appearances, strict=True)
    return Reference(tuple(ReferenceImage(*part) for part in parts), one_place)


def _camera_of(sequence: Sequence, name: str) -> tuple[str, FrameName]:
    """Returns the kind of frames, and the camera, whose images are the reference."""
    if sequence.rig.video is not None:
        return "video", "video"
    if sequence.rig.has_stereo:
        return "stereo", "left"
    raise InputError(f"{name} has neither a video camera nor a stereo pair: give reference images of one camera")


def _points(views: list[View], poses: list[Pose], fx: float, extraction: Extraction, name: str) -> list[Array]:
    """Returns for each view the points (N, 3) of its features in the world, NaN where the distance is unknown.

    Raises InputError where the poses contradict the matches.
    """
    limit = extraction.max_error_px / fx
    matches, agreeing, total = dict[tuple[int, int], NDArray[np.int64]](), 0, 0
    for a, b in sorted({(min(i, j), max(i, j)) for i in range(len(views)) for j in _neighbours(poses, i)}):
        pairs = extraction.matcher.match(views[a].features, views[b].features)
        if not len(pairs):
            continue
        b_from_a = poses[b].inverse() @ poses[a]
        fits = np.abs(sampson_distance(b_from_a, views[a].x[pairs[:, 0]], views[b].x[pairs[:, 1]])) <= limit
        agreeing, total = agreeing + int(fits.sum()), total + len(pairs)
        matches[a, b], matches[b, a] = pairs[fits], pairs[fits][:, ::-1]
    if total < MIN_MATCHES:
        raise InputError(f"{name} has images that show nothing in common ({total} matches): give more of them")
    if agreeing < MIN_FIT * total:
        raise InputError(
            f"{name} has poses that do not fit its images: {agreeing / total:.0%} of the matches agree with them. "
            "Check that the poses are world_from_camera, and that times and calibration are right"
        )
    found = [_intersected(views, poses, matches, i, limit, NOISE_PX / fx) for i in range(len(views))]
    if not any(np.isfinite(xyz).any() for xyz in found):
        raise InputError(f"{name} has reference images without parallax: give images from places farther apart")
    return found


def _neighbours(poses: list[Pose], i: int) -> list[int]:
    """Returns the images with which image i is matched: of those with nearly the same view, by distance."""
    here = poses[i]
    away = np.array([np.linalg.norm(pose.translation - here.translation) for pose in poses])
    cosine = np.array([pose.rotation[:, 2] @ here.rotation[:, 2] for pose in poses])
    order = [int(j) for j in np.argsort(away, kind="stable") if cosine[j] >= SAME_VIEW_COSINE and away[j] > ONE_PLACE]
    return [order[rank] for rank in NEIGHBOURS if rank < len(order)]


def _intersected(
    views: list[View], poses: list[Pose], matches: dict[tuple[int, int], NDArray[np.int64]], i: int, limit: float,
    noise: float,
) -> Array:  # fmt: skip
    """Returns the points (N, 3) of view i from its matches with all others."""
    partners = [j for j in range(len(views)) if (i, j) in matches and len(matches[i, j])]
    xyz = np.full((len(views[i].rays), 3), np.nan)
    if not partners:
        return xyz
    seen_in = [matches[i, j] for j in partners]
    some = np.unique(np.concatenate([pairs[:, 0] for pairs in seen_in]))
    owners = np.concatenate([some, *(pairs[:, 0] for pairs in seen_in)])
    cameras = np.repeat(np.arange(len(partners) + 1), [len(some), *map(len, seen_in)])
    x = np.concatenate([views[i].x[some], *(views[j].x[p[:, 1]] for j, p in zip(partners, seen_in, strict=True))])
    order = np.lexsort((cameras, owners))
    inverses = [poses[j].inverse() for j in (i, *partners)]
    found = intersect(
        np.stack([pose.rotation for pose in inverses]), np.stack([pose.translation for pose in inverses]),
        cameras[order], np.searchsorted(some, owners[order]), x[order], len(some), Noise(noise),
    )  # fmt: skip
    good = (found.depth > 0) & (found.significance >= MIN_SIGNIFICANCE) & (found.worst <= limit)
    xyz[some[good]] = found.xyz_in_world[good]
    return xyz
