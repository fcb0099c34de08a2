"""Finds a second rigid motion besides the one that is followed, and decides which of the two is followed from then on.

This is sequential RANSAC (Torr, Geometric motion segmentation and model selection, 1998): a second rigid motion is
fitted to the points that a frame's pose does not explain. If it explains most of them, and enough of all, something
moves by itself (`second_motion_decision`).

Images do not show which of two bodies is static, but their history does: a moving object is mostly small relative to
the background, and the motion that was there first is taken as the scene (`preferred`).

`monocular` fits the other motion to two views (`explained_by_motion`), as its outliers have no depth; `stereo` fits it
by resection from the map's points, as its outliers have.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.numerics.reductions import lengths
from ispom.solvers.multiview.essential import relative_pose
from ispom.solvers.multiview.rotation import TURN_LOSS, dominant_rotation, rotate
from ispom.types import Check, Decision

Follow = Literal["static", "largest"]
"""Which of two rigid motions to follow: the static scene's, as far as known, or the one that covers more of the
image."""

LEAST = 20
"""Least number of points that a second motion must explain to be reported."""
MOST_OF = 0.5
"""Share of the outliers that a second motion must explain: an essential matrix explains a third of any 30 points, and
up to 60 % of fewer."""
MARKED = 0.1
"""Share of all points from which a second motion counts as an object rather than a few wrong tracks: with 200 points,
the least number that is reported at all."""
SECOND_MOTION = Check(
    "second_motion",
    "share of points that a second rigid motion explains",
    "warning",
    "Does something else move?",
    "<",
    passes="One motion: a second one explains {value:.0%} of the points (limit {threshold:.0%}).",
    fails="Second motion: another rigid motion explains {value:.0%} of the points (limit {threshold:.0%}), so a moving "
    "object may be taken for the scene.",
    topic="motion",
)


SAME_MOTION = 0.8
"""Share of the other points that a motion must explain as well, for points that it explains to be no second motion."""
INLIER = 4.0
"""Inlier limit of the second motion, in loss widths: 2.0 px in the video and 0.7 px in a stereo pair at the defaults.
In a pair the limit of the pose is 2.5 px: points just beyond it, which move alike in a part of the image, are no moving
object."""
SAMPLES = 200
"""Largest number of samples of five points: if half of the points move together, one of 200 samples contains only these
in 998 of 1,000 cases. If none do, a search among 150 takes 5 ms, and ten times as many samples take 27."""


def enough_outliers(outliers: int, count: int) -> bool:
    """Checks whether this number of outliers, of `count` points in all, could be reported as a second motion."""
    return outliers >= max(LEAST, MARKED * count)


def second_motion_decision(explained: NDArray[np.bool_], count: int) -> Decision:
    """Returns the check of a second motion; `explained` (N,) marks which outliers it explains, of `count` points in
    all."""
    also = int(explained.sum())
    share = also / count if also >= max(LEAST, MOST_OF * len(explained)) else 0.0
    tracks = f"{also} of {count} tracks move with it" if share else ""
    return SECOND_MOTION.of(share, MARKED, tracks)


def second_motion(x1: Array, x2: Array, outliers: NDArray[np.bool_], width: float) -> Decision:
    """Returns the check for the outliers (a mask (N,)) among points at normalised coordinates (N, 2) in two views.

    `width` of the robust loss, normalised.
    """
    if enough_outliers(int(outliers.sum()), len(x1)):
        outliers = outliers & ~_of_one_motion(x1, x2, ~outliers, width)
    return second_motion_decision(explained_by_motion(x1[outliers], x2[outliers], width), len(x1))


def _of_one_motion(x1: Array, x2: Array, others: NDArray[np.bool_], width: float) -> NDArray[np.bool_]:
    """Returns which of all points (N, 2) in two views one motion of the camera explains in a scene at rest, if it
    explains the `others` (N,), which are no outliers; none if no motion does.

    Near points of a camera that starts to drive are outliers of the far ones, which look like rest or a zoom. Whether
    they move by themselves cannot be told from two views then.
    """
    found = relative_pose(x1, x2, width, SAMPLES)
    if found is None:
        return np.zeros(len(x1), bool)
    explained = ~off_epipolar_lines(found.second_from_first, x1, x2, INLIER * width)
    enough = explained[others].sum() >= SAME_MOTION * others.sum()
    return explained if enough else np.zeros(len(x1), bool)


def explained_by_motion(x1: Array, x2: Array, width: float) -> NDArray[np.bool_]:
    """Returns which of the points (N, 2) in two views the best rigid motion explains; none of fewer than LEAST.

    A pure rotation is tried first; it includes no motion at all, of a static object before a static camera.
    """
    if len(x1) < LEAST:
        return np.zeros(len(x1), bool)
    rotation = dominant_rotation(x1, x2, TURN_LOSS * width)
    rotated = np.linalg.norm(rotate(rotation, x1) - x2, axis=1) < INLIER * width
    found = relative_pose(x1, x2, width, SAMPLES)
    return rotated if found is None or found.inliers.sum() <= rotated.sum() else found.inliers


def off_epipolar_lines(second_from_first: Pose, x1: Array, x2: Array, limit: float) -> NDArray[np.bool_]:
    """Returns which points (N, 2) in two views are farther than `limit` (normalised) from their epipolar lines.

    A static point in front of the cameras lies on its line in the second view, at any depth. The line starts at the
    projection of a point at infinity (Hartley and Zisserman, section 9.5).
    """
    far = rotate(second_from_first.rotation, x1)
    line = second_from_first.translation[:2] - far * second_from_first.translation[2]
    line /= np.maximum(lengths(line), 1e-12)[:, None]
    moved = x2 - far
    along = np.maximum(moved[:, 0] * line[:, 0] + moved[:, 1] * line[:, 1], 0.0)[:, None]
    return lengths(moved - along * line) > limit


CLEARLY = 1.5
"""Ratio of the extents of both motions' points from which the other motion, if it is larger, is the static scene."""
AS_OLD = 0.25
"""Share of a motion's points that must be as old as the older half of the other's; below it the motion is newer. The
share is a half where both began together."""
CELLS = 8, 6
"""Cells of the image, across and down, by which areas are measured: a cell counts once, however many corners it has."""
WIDER = Check(
    "other_wider",
    "extent of the other motion's points / of those followed",
    "trigger",
    "Which motion is the scene?",
    passes="Switched to the other motion: it is older, or its points extend {value} times as far ({threshold} needed).",
    fails="Same motion as before: the other one is newer, or its points extend only {value} times as far ({threshold} "
    "needed).",
)
LARGER = Check(
    "other_larger",
    "area in the image of the other motion / of the one followed",
    "trigger",
    "Which motion is the scene?",
    ">",
    passes="Switched to the other motion: it covers {value} times the image area (more than {threshold} needed).",
    fails="Same motion as before: the other one covers {value} times the image area (more than {threshold} needed).",
)


@dataclass(frozen=True, eq=False)
class Moving:
    """Points that follow one rigid motion."""

    ids: NDArray[np.int64]
    """(N,) ids of the tracks: later tracks have larger ids."""
    uv: NDArray[np.float32]
    """(N, 2) [px] positions in the image."""
    xyz: Array
    """(N, 3) positions in the world before the two motions were separated; NaN where untriangulated."""

    @property
    def room(self) -> float:
        """Extent of the points: the diagonal of the box between the 10th and 90th percentile along each axis."""
        known = self.xyz[np.isfinite(self.xyz[:, 0])]
        return float(np.linalg.norm(np.ptp(np.percentile(known, (10, 90), axis=0), axis=0))) if len(known) else 0.0

    def came_after(self, other: Moving) -> bool:
        """Checks whether hardly any of its points is as old as the older half of the other's."""
        return bool(np.mean(self.ids <= np.median(other.ids)) < AS_OLD)

    def area(self, size: tuple[int, int]) -> int:
        """Returns the number of image cells that contain one of its points; `size` (width, height) of the image in
        pixels."""
        cells = np.clip((self.uv / size * CELLS).astype(np.int64), 0, np.array(CELLS) - 1)
        return len(np.unique(cells[:, 0] * CELLS[1] + cells[:, 1]))


MORE = 1.0
"""Ratio of the image areas of the other motion and the followed one, from which the other covers more. It is low, as
the other motion's tracks end in each image."""


def preferred(follow: Follow, other: Moving, own: Moving, size: tuple[int, int]) -> Decision:
    """Decides whether to switch to the other motion; `size` (width, height) of the image in pixels.

    For "static", the older motion is the scene, however much of the image the newer one covers. Of two motions that
    began together, the one whose points have the larger extent is the scene.
    """
    if follow == "largest":
        return LARGER.of(other.area(size) / max(own.area(size), 1), MORE)
    span = other.room / max(own.room, 1e-12)
    if other.came_after(own):
        return WIDER.of(span, CLEARLY, "it is newer", passed=False)
    if own.came_after(other):
        return WIDER.of(span, CLEARLY, "it is older", passed=True)
    return WIDER.of(span, CLEARLY)
