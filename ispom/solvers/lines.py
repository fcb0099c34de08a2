"""Geometry of straight lines: vanishing directions, the rotation from them, and the pose from known lines.

An image line and the centre of the camera span a plane with unit normal n (camera frame), which contains the line of
the scene: n . (R x + t) = 0 for its points x, and n . R d = 0 for its direction d (Hartley and Zisserman 2003, 8.1;
Taylor and Kriegman, Structure and motion from line segments, PAMI 1995). Residuals are distances in the image: of the
projected ends from the observed line, and of the observed ends from a line to the vanishing point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose, so3_exp

DIRECTION_SAMPLES = 400
"""Number of RANSAC samples of two lines for each vanishing direction: one with 10 % of the lines is sampled with a
probability of 98 % (formula of Fischler and Bolles 1981)."""
MIN_LINES_OF_DIRECTION, MIN_SHARE_OF_DIRECTION = 8, 0.06
"""Least number of lines of a vanishing direction, and their least share of the total length of all lines."""
MAX_SLOPE = np.tan(np.radians(2.5))
"""Tangent of the largest angle (2.5 degrees) between a segment and the line to its vanishing point; the offset of the
ends alone would admit short segments of any direction."""
DIRECTION_ITERATIONS = 6
"""Number of least-squares iterations of a vanishing direction."""
MAX_DIRECTIONS = 4
"""Largest number of vanishing directions of one image."""
SAMPLES, SAMPLE_SIZE, SAMPLE_ITERATIONS = 200, 4, 5
"""Number of samples of lines for a pose, lines of each, and Gauss-Newton iterations on each. Three lines fix the pose;
with four, degenerate samples are rare."""
POSE_ITERATIONS = 12
"""Number of Gauss-Newton iterations of the refined pose."""
MAX_STEP = np.array([3.0] * 3 + [0.3] * 3)
"""(6,) largest step of an iteration: translation [unit of the scene], rotation [rad]. Bad samples would diverge."""
MIN_DEPTH = 1e-2
"""Least depth of a projected end; ends behind the camera count as outliers."""


@dataclass(frozen=True, eq=False)
class Observed:
    """N segments of one image, normalised."""

    x: Array
    """(N, 2, 2) both ends on the plane z = 1."""

    @property
    def length(self) -> Array:
        """Returns the lengths (N,), normalised."""
        return np.linalg.norm(self.x[:, 1] - self.x[:, 0], axis=1)

    @property
    def middles(self) -> Array:
        """Returns the unit rays (N, 3) of the segments' middles."""
        rays = _rays(self.x.mean(axis=1))
        return rays / np.linalg.norm(rays, axis=1, keepdims=True)

    @property
    def normals(self) -> Array:
        """Returns the unit normals (N, 3) of the planes through the camera's centre."""
        n = np.cross(*np.moveaxis(_rays(self.x), 1, 0))
        return n / np.linalg.norm(n, axis=1, keepdims=True)

    @property
    def lines(self) -> Array:
        """Returns the line coefficients (N, 3), whose product with (x, y, 1) is the distance from the line."""
        n = self.normals
        return n / np.linalg.norm(n[:, :2], axis=1, keepdims=True)

    def __len__(self) -> int:
        return len(self.x)

    def __getitem__(self, some: NDArray) -> Observed:
        return Observed(self.x[some])


def _rays(x: Array) -> Array:
    return np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=-1)


def offsets_from_direction(seen: Observed, directions: Array) -> Array:
    """Returns the normalised distances (N, D) of each segment's ends from the line through its middle and the vanishing
    point of each unit direction (D, 3)."""
    middle = _rays(seen.x.mean(axis=1))
    through = np.cross(middle[:, None], directions[None])
    scale = np.maximum(np.linalg.norm(through[..., :2], axis=2), 1e-9)
    return np.abs(np.einsum("ndi,ni->nd", through, _rays(seen.x[:, 0]))) / scale


def vanishing_directions(seen: Observed, limit: float, seed: int = 0) -> tuple[Array, NDArray[np.int64]]:
    """Returns the unit vanishing directions (D, 3) in the camera, and the index (N,) of each segment's one, or -1.

    Sequential RANSAC, then least squares. `limit`: largest offset of an end, normalised.
    """
    group, directions = np.full(len(seen), -1), list[Array]()
    rng, normals, length = np.random.default_rng(seed), seen.normals, seen.length
    limits = np.minimum(limit, MAX_SLOPE * length / 2)
    total = length.sum()
    while len(directions) < MAX_DIRECTIONS:
        free = np.flatnonzero(group < 0)
        if len(free) < MIN_LINES_OF_DIRECTION:
            break
        weight = length[free] / length[free].sum()
        first, second = rng.choice(free, (2, DIRECTION_SAMPLES), p=weight)
        candidates = np.cross(normals[first], normals[second])
        size = np.linalg.norm(candidates, axis=1)
        candidates = candidates[size > 1e-3] / size[size > 1e-3, None]
        if not len(candidates):
            break
        fits = offsets_from_direction(seen[free], candidates) < limits[free, None]
        direction = candidates[int((fits * length[free, None]).sum(axis=0).argmax())]
        for _ in range(DIRECTION_ITERATIONS):
            offset = offsets_from_direction(seen[free], direction[None])[:, 0]
            weight = 1 / (1 + (offset / (0.5 * limit)) ** 2) ** 2 * (offset < 2 * limits[free])
            n = normals[free] * (length[free] * np.sqrt(weight))[:, None]
            direction = np.linalg.eigh(n.T @ n)[1][:, 0]
        inliers = free[offsets_from_direction(seen[free], direction[None])[:, 0] < limits[free]]
        if len(inliers) < MIN_LINES_OF_DIRECTION or length[inliers].sum() < MIN_SHARE_OF_DIRECTION * total:
            break
        group[inliers] = len(directions)
        directions.append(direction)
    axes = np.array(directions).reshape(-1, 3)
    if len(axes):
        offsets = offsets_from_direction(seen, axes)
        group = np.where(offsets.min(axis=1) < limits, offsets.argmin(axis=1), -1)
    return axes, group


def rotation_from_directions(
    seen: Array, known: Array, predicted: Array, limit_rad: float
) -> tuple[Array, NDArray[np.int64]]:
    """Returns the rotation camera_from_world (3, 3) from vanishing directions, and the index (D,) of each one's match.

    `known` (K, 3): directions in the world. `seen` (D, 3): directions in the camera. They are matched by the
    `predicted` rotation (3, 3), to within `limit_rad`; -1 for no match. Components of the rotation that the directions
    do not determine are those of the prediction.
    """
    match = np.full(len(seen), -1)
    if not len(seen) or not len(known):
        return predicted, match
    cosine = seen @ (known @ predicted.T).T
    free = np.abs(cosine)
    while free.max() > np.cos(limit_rad):
        i, j = np.unravel_index(free.argmax(), free.shape)
        match[i] = j
        free[i], free[:, j] = 0.0, 0.0
    pairs = np.flatnonzero(match >= 0)
    if not len(pairs):
        return predicted, match
    sign = np.sign(cosine[pairs, match[pairs]])
    covariance = (sign[:, None] * seen[pairs]).T @ known[match[pairs]] + 1e-3 * predicted
    u, _, vt = np.linalg.svd(covariance)
    return u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt, match


@dataclass(frozen=True, eq=False)
class KnownLines:
    """N lines of the scene that are observed in one image."""

    seen: Observed
    xyz: Array
    """(N, 2, 3) both ends in the world."""
    sigma: Array
    """(N, 2) standard deviation of the distances of the ends from the observed lines, normalised."""

    def __getitem__(self, some: NDArray) -> KnownLines:
        return KnownLines(self.seen[some], self.xyz[some], self.sigma[some])


@dataclass(frozen=True, eq=False)
class KnownDirections:
    """N segments of known direction in the world."""

    seen: Observed
    direction: Array
    """(N, 3) unit vectors."""
    sigma: Array
    """(N,) standard deviation of the offset of a segment's ends, normalised."""


def end_offsets(rotations: Array, translations: Array, lines: Array, xyz: Array) -> Array:
    """Returns the signed distances (M, N, 2) of the ends (M, N, 2, 3) or (N, 2, 3), projected under camera_from_world
    (M, 3, 3), (M, 3), from observed lines (M, N, 3) or (N, 3); inf behind a camera."""
    q = np.einsum("mij,...nej->mnei", rotations, xyz) if xyz.ndim == 3 else np.einsum("mij,mnej->mnei", rotations, xyz)
    q = q + translations[:, None, None]
    depth = np.where(q[..., 2] > MIN_DEPTH, q[..., 2], np.nan)
    offset = np.einsum("...ni,...nei->...ne", lines, q) / depth
    return np.where(np.isfinite(offset), offset, np.inf)


def _steps(rotations: Array, translations: Array, lines: Array, xyz: Array) -> tuple[Array, Array]:
    """Returns residuals (M, N, 2) and their derivatives (M, N, 2, 6) by a left twist of camera_from_world."""
    q = np.einsum("mij,mnej->mnei", rotations, xyz) + translations[:, None, None]
    valid = q[..., 2] > MIN_DEPTH
    inverse = np.where(valid, 1 / np.where(valid, q[..., 2], 1.0), 0.0)
    offset = np.einsum("mni,mnei->mne", lines, q) * inverse
    by_point = np.repeat(lines[:, :, None], 2, axis=2) * inverse[..., None]
    by_point[..., 2] -= offset * inverse
    return np.where(valid, offset, 0.0), np.concatenate([by_point, np.cross(q, by_point)], axis=3)


def sampled_pose(known: KnownLines, guesses: list[Pose], limit: float, seed: int = 0) -> Pose:
    """Returns the camera_from_world with most inliers: of the guesses, and of Gauss-Newton on samples from each guess.

    `limit`: largest offset of an inlier's end, in units of its sigma.
    """
    rng, count = np.random.default_rng(seed), len(known.xyz)
    lines = known.seen.lines
    rotations, translations = (np.stack([getattr(g, n) for g in guesses]) for n in ("rotation", "translation"))
    all_r, all_t = [rotations], [translations]
    if count >= SAMPLE_SIZE:
        chosen = np.stack([rng.choice(count, SAMPLE_SIZE, replace=False) for _ in range(SAMPLES)])
        for guess in guesses:
            r, t = np.repeat(guess.rotation[None], SAMPLES, axis=0), np.repeat(guess.translation[None], SAMPLES, axis=0)
            for _ in range(SAMPLE_ITERATIONS):
                residual, by = _steps(r, t, lines[chosen], known.xyz[chosen])
                a, b = by.reshape(SAMPLES, -1, 6), residual.reshape(SAMPLES, -1)
                normal = np.einsum("mki,mkj->mij", a, a) + 1e-9 * np.eye(6)
                step = -np.linalg.solve(normal, np.einsum("mki,mk->mi", a, b)[..., None])[..., 0]
                step = np.clip(step, -MAX_STEP, MAX_STEP)
                turn = so3_exp(step[:, 3:])
                r, t = turn @ r, np.einsum("mij,mj->mi", turn, t) + step[:, :3]
            all_r.append(r)
            all_t.append(t)
    rotations, translations = np.concatenate(all_r), np.concatenate(all_t)
    error = np.abs(end_offsets(rotations, translations, lines, known.xyz)) / known.sigma
    cost = (np.minimum(np.nan_to_num(error, nan=np.inf) / limit, 1.0) ** 2).sum(axis=(1, 2))
    best = int(cost.argmin())
    return Pose(rotations[best], translations[best])


def refined_pose(
    known: KnownLines, directions: KnownDirections | None, start: Pose, width: float
) -> tuple[Pose, Array]:
    """Returns camera_from_world by robust Gauss-Newton, and the information (6, 6) of its left twist.

    `width`: of the robust loss, in standard deviations.
    """
    pose, lines = start, known.seen.lines
    normal = np.eye(6)
    for _ in range(POSE_ITERATIONS):
        residual, by = _steps(pose.rotation[None], pose.translation[None], lines[None], known.xyz[None])
        r, a = (residual[0] / known.sigma).ravel(), (by[0] / known.sigma[..., None]).reshape(-1, 6)
        if directions is not None and len(directions.seen):
            more, by_turn = direction_steps(pose.rotation, directions)
            r = np.concatenate([r, more / directions.sigma])
            a = np.concatenate([a, np.hstack([np.zeros_like(by_turn), by_turn]) / directions.sigma[:, None]])
        weight = 1 / (1 + (r / width) ** 2)
        normal = (a * weight[:, None]).T @ a + 1e-9 * np.eye(6)
        step = np.clip(-np.linalg.solve(normal, a.T @ (weight * r)), -MAX_STEP, MAX_STEP)
        pose = Pose.exp(step) @ pose
        if np.abs(step).max() < 1e-8:
            break
    return Pose.from_xyzw(pose.xyzw, pose.translation), normal


def direction_steps(rotation: Array, known: KnownDirections) -> tuple[Array, Array]:
    """Returns the signed offsets (N,) of segments from their vanishing points, and the derivatives (N, 3) by a left
    rotation vector."""
    v = known.direction @ rotation.T
    normals = known.seen.normals
    along = np.linalg.norm(np.cross(known.seen.middles, v), axis=1)
    # Half the length times the angle between the segment and the line to its vanishing point.
    scale = 0.5 * known.seen.length / np.maximum(along, 0.1)
    return scale * np.einsum("ni,ni->n", normals, v), scale[:, None] * np.cross(v, normals)


def depths_on_lines(x: Array, xyz: Array) -> Array:
    """Returns the depths (N, 2) where the rays of normalised points (2 N, 2) pass nearest to lines through points
    (N, 2, 3) of the camera; NaN along the line."""
    _, rd, dd, rp, dp, below = _products(x, xyz)
    return (rp * dd - rd * dp) / below


def nearest_on_lines(x: Array, xyz: Array) -> Array:
    """Returns the points (N, 2, 3) of these lines that are nearest to the rays; NaN along the line."""
    rr, rd, _, rp, dp, below = _products(x, xyz)
    return xyz[:, :1] + ((rd * rp - rr * dp) / below)[..., None] * (xyz[:, 1:] - xyz[:, :1])


def _products(x: Array, xyz: Array) -> tuple[Array, ...]:
    """Returns the terms (N, 2) of the normal equations of the distance between ray r and line p + s d."""
    rays, start = _rays(x.reshape(-1, 2, 2)), xyz[:, :1]
    along = xyz[:, 1:] - start
    rr, rd, dd = (rays * rays).sum(2), (rays * along).sum(2), (along * along).sum(2)
    below = rr * dd - rd**2
    return rr, rd, dd, (rays * start).sum(2), (along * start).sum(2), np.where(below > 1e-12, below, np.nan)


def squared(directions: Array, limit_rad: float) -> Array:
    """Makes unit directions (K, 3) orthogonal to the first ones where they are nearly so, to within `limit_rad`."""
    out = directions.copy()
    for k in range(1, len(out)):
        for before in out[:k]:
            cosine = out[k] @ before
            if abs(cosine) < np.sin(limit_rad):
                out[k] -= cosine * before
        out[k] /= np.linalg.norm(out[k])
    return out
