"""Common parts of the methods of lines: segments of an image, lines of the scene, directions, and the map of lines."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ispom.features.segments import Detector, detect_segments
from ispom.geometry import Array, Pose
from ispom.settings import Range
from ispom.solvers.lines import (
    KnownDirections,
    Observed,
    rotation_from_directions,
    squared,
    vanishing_directions,
)
from ispom.types import Camera, Check, Image, ImageLines, Tracks, TrackStatus, WorldLines

NOISE_PX = 0.5
"""Standard deviation of the end of a segment across it [px]."""
DIRECTION_PX = 1.0
"""Standard deviation of the offset of a segment's end from the line to its vanishing point; bricks are not exact."""
INDEPENDENT = 64
"""Segments of one image share errors (bricks that are not exact, wrong members): all together count as this number."""
VANISHING_PX = 1.5
"""Largest offset of a segment's end from the line to the vanishing point."""
SAME_DIRECTION_RAD = np.radians(12.0)
"""Vanishing directions that differ by less are the same direction."""
RIGHT_ANGLE_RAD = np.radians(3.0)
"""Largest difference from a right angle of directions in a Manhattan world."""
MAX_DIRECTIONS, MAX_COUNT, MAX_MAPPED = 5, 10, 3000
"""Directions in the world, images that each is the mean of, and lines of the map."""
WITHOUT_DIRECTION = MAX_DIRECTIONS
"""Group of lines that point to no vanishing point."""

DIRECTIONS = Check(
    "directions", "known vanishing directions in the image", "finding", "Rotation from directions?",
    passes="{value} known vanishing directions are in the image: they give the rotation ({threshold} suffice).",
    fails="{value} known vanishing directions are in the image ({threshold} give the whole rotation).",
)  # fmt: skip


@dataclass(frozen=True)
class SegmentSettings:
    """Settings of both methods: which segments are found."""

    detector: Detector = "lsd"
    """lsd: line segment detector; hough: Canny's edges and Hough's transform; canny: Canny's edges, split into straight
    pieces."""
    max_segments: Annotated[int, Range(20, 2000)] = 400
    """The longest ones are used."""
    manhattan: bool = False
    """Vanishing directions near right angles are taken as right angles."""


@dataclass(frozen=True, eq=False)
class Seen:
    """The N segments of one image."""

    uv: NDArray[np.float32]
    """(N, 2, 2) [px]."""
    normalised: Observed
    found: Array
    """(D, 3) vanishing directions in the camera, of length 1."""
    points_to: NDArray[np.int64]
    """(N,) which one each segment points to, or -1."""

    @staticmethod
    def of(grey: Image, camera: Camera, detector: Detector, min_length_px: float, most: int) -> Seen:
        uv = detect_segments(grey, detector, min_length_px, most)
        normalised = Observed(camera.normalise(uv.reshape(-1, 2).astype(float)).reshape(-1, 2, 2))
        return Seen(uv, normalised, *vanishing_directions(normalised, VANISHING_PX / camera.fx))


@dataclass(frozen=True, eq=False)
class SceneLines:
    """N lines as seen in the last image, with their places in the scene."""

    ids: NDArray[np.int64]
    uv: NDArray[np.float32]
    """(N, 2, 2) [px]."""
    xyz: Array
    """(N, 2, 3) both ends in the world; NaN where they are not known yet."""
    sigma_px: Array
    """(N, 2) of the disparities at both ends, where there are disparities."""
    views: NDArray[np.int64]
    """(N,) number of images that saw it."""
    group: NDArray[np.int64]
    """(N,) number of its direction in the world, or WITHOUT_DIRECTION."""
    missed: NDArray[np.int64]
    """(N,) number of images, up to the last one, in which its points were followed without a segment there."""

    @staticmethod
    def new(
        first_id: int, uv: NDArray[np.float32], group: NDArray[np.int64], xyz: Array | None = None,
        sigma_px: Array | None = None,
    ) -> SceneLines:  # fmt: skip
        """Returns segments (N, 2, 2) that are seen for the first time."""
        count = len(uv)
        xyz = np.full((count, 2, 3), np.nan) if xyz is None else xyz
        sigma_px = np.full((count, 2), np.nan) if sigma_px is None else sigma_px
        ones = np.ones(count, np.int64)
        return SceneLines(first_id + np.arange(count), uv, xyz, sigma_px, ones, group, 0 * ones)

    @staticmethod
    def empty() -> SceneLines:
        return SceneLines.new(0, np.zeros((0, 2, 2), np.float32), np.zeros(0, np.int64))

    def __len__(self) -> int:
        return len(self.ids)

    def __getitem__(self, some: NDArray | slice) -> SceneLines:
        return SceneLines(*(getattr(self, f.name)[some] for f in fields(self)))

    def and_more(self, more: SceneLines) -> SceneLines:
        return SceneLines(*(np.concatenate([getattr(self, f.name), getattr(more, f.name)]) for f in fields(self)))


@dataclass(frozen=True, eq=False)
class LineMap:
    """The directions that lines of the scene share, and the lines that are known."""

    directions: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """(K, 3) unit vectors in the world."""
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(K,) images that each direction is the mean of."""
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(M,) ascending."""
    lines: WorldLines = field(default_factory=WorldLines.empty)
    """M lines."""

    def without_directions(self) -> LineMap:
        return replace(self, directions=np.zeros((0, 3)), counts=np.zeros(0, np.int64))

    def rotation(self, seen: Seen, predicted: Array) -> tuple[Array, NDArray[np.int64]]:
        """Returns camera_from_world (3, 3) by the directions that are known, and which one each of those seen is."""
        return rotation_from_directions(seen.found, self.directions, predicted, SAME_DIRECTION_RAD)

    def pointing(self, seen: Seen, same: NDArray[np.int64], px: float) -> KnownDirections:
        """Returns the segments whose direction in the world is known; `px` is the size of a pixel, normalised."""
        world = np.append(same, -1)[seen.points_to]
        some = world >= 0
        count = int(some.sum())
        sigma = DIRECTION_PX * px * np.sqrt(max(count / INDEPENDENT, 1.0))
        return KnownDirections(seen.normalised[some], self.directions[world[some]], np.full(count, sigma))

    def with_directions(self, seen: Seen, pose: Pose, manhattan: bool) -> tuple[LineMap, NDArray[np.int64]]:
        """Returns the map with the vanishing directions of an image at this pose, and the group (N,) of each segment.

        A known direction is the mean of the first MAX_COUNT images that saw it, so that errors of poses do not
        accumulate in it.
        """
        rotation = pose.rotation
        _, same = self.rotation(seen, rotation.T)
        directions, counts = self.directions.copy(), self.counts.copy()
        for n, v in enumerate(seen.found @ rotation.T):
            k = same[n]
            if k >= 0 and counts[k] < MAX_COUNT:
                mean = counts[k] * directions[k] + np.sign(directions[k] @ v) * v
                directions[k], counts[k] = mean / np.linalg.norm(mean), counts[k] + 1
            elif k < 0 and len(directions) < MAX_DIRECTIONS:
                same[n] = len(directions)
                directions, counts = np.vstack([directions, v]), np.append(counts, 1)
        if manhattan:
            directions = squared(directions, RIGHT_ANGLE_RAD)
        world = np.append(same, -1)[seen.points_to]
        group = np.where(world >= 0, world, WITHOUT_DIRECTION)
        return replace(self, directions=directions, counts=counts), group

    def with_lines(self, ids: NDArray[np.int64], xyz: Array, group: NDArray[np.int64]) -> LineMap:
        """Returns the map with the latest places (N, 2, 3) of lines; the oldest go where there are too many."""
        rest = self.without(ids)
        ids = np.concatenate([rest.ids, ids])
        xyz, group = np.concatenate([rest.lines.xyz_in_world, xyz]), np.concatenate([rest.lines.group, group])
        order = np.argsort(ids, kind="stable")[-MAX_MAPPED:]
        return replace(self, ids=ids[order], lines=WorldLines(xyz[order], group[order]))

    def without(self, ids: NDArray[np.int64]) -> LineMap:
        stay = ~np.isin(self.ids, ids)
        return replace(
            self, ids=self.ids[stay], lines=WorldLines(self.lines.xyz_in_world[stay], self.lines.group[stay])
        )

    def of(self, ids: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
        """Returns places (N, 2, 3) and groups (N,) of lines; NaN and WITHOUT_DIRECTION of those that are not here."""
        if not len(self.ids):
            return np.full((len(ids), 2, 3), np.nan), np.full(len(ids), WITHOUT_DIRECTION)
        at = np.minimum(np.searchsorted(self.ids, ids), len(self.ids) - 1)
        here = self.ids[at] == ids
        xyz = np.where(here[:, None, None], self.lines.xyz_in_world[at], np.nan)
        return xyz, np.where(here, self.lines.group[at], WITHOUT_DIRECTION)


def drawn(uv: NDArray[np.float32], lines: SceneLines) -> ImageLines:
    """Returns segments (N, 2, 2) in the colours of their directions, and those that are none of the lines unused."""
    used = np.all(uv.reshape(-1, 1, 4) == lines.uv.reshape(1, -1, 4), axis=2)
    group = np.where(np.any(used, axis=1), lines.group[used.argmax(axis=1)] if len(lines) else -1, -1)
    return ImageLines.of(uv, group)


def middles(
    old: SceneLines, now: NDArray[np.float32], fits: NDArray[np.bool_], residual: Array, lines: SceneLines
) -> Tracks:
    """Returns the middles of the old lines in their new segments (N, 2, 2), those that do not fit the pose as ended,
    and of new lines. They are for display: the middle of a segment is no point of the scene.
    """
    new = lines[lines.views == 1]
    gap = np.full(len(new), np.nan)
    status = np.where(fits, int(TrackStatus.ALIVE), int(TrackStatus.RIGID))
    return Tracks.of(
        np.concatenate([old.ids, new.ids]),
        np.concatenate([now.mean(axis=1), new.uv.mean(axis=1)]),
        uv_prev=np.concatenate([old.uv.mean(axis=1), np.column_stack([gap, gap])]),
        status=np.concatenate([status, np.full(len(new), int(TrackStatus.NEW))]),
        residual_px=np.concatenate([residual, gap]),
    )
