"""Velocity of one camera from dense optical flow: the paper's "differential" class, and the visual egomotion estimation
(vEE) of its Table 1 (Bruss and Horn, Passive Navigation, 1983; Heeger and Jepson, Subspace Methods, 1992; the flow of
Kroeger et al., Fast Optical Flow using Dense Inverse Search, 2016).

The steps, in the order of this file:

1. Dense flow from the last image to this one, and back. It is sampled at corners spread over the image; samples whose
   way back does not close, or whose surroundings look different at the end, are discarded.
2. In a static scene, flow = A(x) v / depth + B(x) w, with the velocity v and the rotation rates w of the camera. For
   a direction of v, depths drop out along one line per vector, and w is linear (Bruss and Horn). The direction is
   searched on the whole sphere, then refined together with w by Gauss-Newton with a robust loss. Depths in front of the
   camera decide about its sign.
3. If a rotation alone explains the flow, the direction is undetermined: the last one is kept, and the camera counts as
   turning on the spot.

The result is a direction and rotation rates in each frame. Speed is not observable: the path is drawn with steps of
length 1 in each frame in which the camera moves, whatever its speed was. It does not show where the camera was.

Figures (medians against the truth): KITTI 06, 51 frames: direction 0.3 degrees, rates 0.19 degrees/s; sim:city, 100
frames: 0.2 degrees and 0.09 degrees/s. It fails where the flow is not that of a static scene, where images differ by
more than about a tenth of their width, and costs half a second for a frame of 1241 x 376 pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.estimator import VIDEO, Method
from ispom.estimators.survey.common import OneKind, Result
from ispom.estimators.survey.photometric import correlations, sample, square_patch
from ispom.features.shi_tomasi import detect_spread
from ispom.geometry import Array, Pose, so3_exp
from ispom.numerics.reductions import lengths, median
from ispom.numerics.robust import robust_weights
from ispom.settings import Range, checked
from ispom.stopwatch import Stopwatch
from ispom.types import Check, Decision, Frame, Image, ImageLines, Rig, as_grey, by_key

MIN_DISTANCE_PX = 8.0
"""Least distance between samples of the flow."""
MAX_CIRCLE_PX = 1.0
"""Largest distance of the way forth and back from its start."""
PATCH, MIN_CORRELATION = square_patch(7), 0.7
"""Surroundings of a sample, and how similar they must be at both ends of its vector."""
MIN_SIDE_PX = 32
"""Smaller images have no dense flow."""
DIRECTIONS, STARTS, SEARCHED = 200, 3, 150
"""Directions on half of the sphere that are searched, 10 degrees apart; the number of them that are refined; and the
number of vectors that decide about them."""
SEARCH_ROUNDS, ITERATIONS = 3, 20
LOSS_PX, INLIER_PX = 0.5, 1.5
"""Width of the robust loss, and largest residual of an inlier: flow at corners has deviations of 0.2 to 0.4 px."""
CROSS_PX = 12.0
"""Arms of the cross at the focus of expansion."""

VECTORS = Check(
    "flow_vectors", "flow vectors", "requirement", "Flow found?",
    passes="{value} flow vectors ({threshold} needed).",
    fails="No flow: {value} vectors are consistent ({threshold} needed).",
)  # fmt: skip
AGREE = Check(
    "flow_inliers", "share of flow vectors that agree with one motion", "requirement", "Motion found?", topic="pose",
    passes="Motion found: {value:.0%} of the flow vectors agree with it ({threshold:.0%} needed).",
    fails="Lost: {value:.0%} of the flow vectors agree with one motion ({threshold:.0%} needed).",
)  # fmt: skip
RESIDUAL = Check(
    "flow_residual", "median residual of the flow", "warning", relation="<=", unit="px",
    passes="The flow fits the motion within {value:.2f} px (limit {threshold} px).",
    fails="The flow fits the motion only within {value:.2f} px (limit {threshold} px).",
)  # fmt: skip
TRANSLATES = Check(
    "translation_flow", "median flow that the rotation does not explain", "finding", "Direction determined?",
    unit="px", topic="motion",
    passes="Direction of translation determined: {value:.2f} px of flow besides the rotation ({threshold} px needed).",
    fails="Direction of translation held: {value:.2f} px of flow besides the rotation ({threshold} px needed).",
)  # fmt: skip
RATE = Check(
    "rotation_rate", "rotation rate", "finding", unit="degrees/s",
    passes="The camera rotates by {value:.1f} degrees/s.",
    fails="The camera rotates by {value:.1f} degrees/s: hardly.",
)  # fmt: skip
HEADING = Check(
    "heading", "angle between direction of translation and optical axis", "finding", relation="<=", unit="degrees",
    passes="The camera moves forward, {value:.1f} degrees from its optical axis.",
    fails="The camera moves backward, {value:.1f} degrees from its optical axis.",
)  # fmt: skip
CHECKS = by_key(VECTORS, AGREE, RESIDUAL, TRANSLATES, RATE, HEADING)
LEAST_RATE_DEG_S, SIDEWAYS_DEG = 0.3, 90.0
"""Thresholds of the findings: least rate that counts as a rotation (the accuracy of the rates), and the angle that is
neither forward nor backward."""
STAGES = {
    "flow": "Computes the dense flow in both directions and samples it at corners.",
    "egomotion": "Searches the direction of translation on the sphere, and refines it with the rotation rates.",
}


@dataclass(frozen=True)
class FlowConfig:
    """Settings of the flow method."""

    max_vectors: Annotated[int, Range(50, 5000)] = 600
    """Samples of the flow, spread over the image."""
    min_vectors: Annotated[int, Range(8, 500)] = 30
    """Least number of consistent vectors; with fewer no motion is computed."""
    min_agreeing: Annotated[float, Range(0.1, 0.95)] = 0.5
    """Least share of vectors that agree with the motion."""
    min_translation_px: Annotated[float, Range(0.05, 5)] = 0.4
    """Least median flow besides the rotation for which the direction is determined [px]."""
    max_lost_frames: Annotated[int, Range(0, 50)] = 2
    """Frames that may fail against the last located one before the next starts a new segment from the last pose."""

    def build(self, rig: Rig) -> Flow:
        return Flow(rig, checked(self))


@dataclass(frozen=True, eq=False)
class Motion:
    """Velocity of a camera during one frame interval, in the axes of the middle of the interval. N vectors."""

    direction: Array
    """(3,) of the translation, length 1."""
    rotation_rad: Array
    """(3,) rotation vector of the interval."""
    residuals: Array
    """(N,) distances of the vectors from their lines, normalised coordinates."""
    translation_flow: Array
    """(N, 2) flow without the rotation, normalised coordinates."""


@dataclass(frozen=True, eq=False)
class Memory:
    """The last located image, and the motion there."""

    grey: Image
    time_ns: int
    world_from_camera: Pose = field(default_factory=Pose)
    direction: Array | None = None
    """(3,) of the translation; None before the first."""
    lost_frames: int = 0
    restarted: bool = False
    """Whether the image was not located: the next pose begins a new segment."""


@dataclass(frozen=True, eq=False)
class Flow(OneKind["Memory | None"]):
    """Gives each frame the direction of its motion and its rotation; poses have steps of length 1. World: the first."""

    rig: Rig
    config: FlowConfig
    kind = "video"
    frame = "video"

    def begin(self) -> Memory | None:
        return None

    def process(self, memory: Memory | None, frame: Frame, watch: Stopwatch) -> tuple[Memory | None, Result]:
        grey, config, camera = as_grey(frame.image), self.config, self.rig.camera("video")
        if memory is None:
            watch.lap("flow")
            return Memory(grey, frame.time_ns), Result()
        start, end = flow_vectors(memory.grey, grey, config.max_vectors)
        enough = VECTORS.of(len(start), config.min_vectors)
        watch.lap("flow")
        if not enough.passed:
            return self._lost(memory, frame, grey, (enough,))
        before, now = camera.normalise(start), camera.normalise(end)
        motion = egomotion((before + now) / 2, now - before, LOSS_PX / camera.fx)
        residuals_px = camera.fx * motion.residuals
        inliers = residuals_px <= INLIER_PX
        agree = AGREE.of(inliers.mean(), config.min_agreeing)
        watch.lap("egomotion")
        if not agree.passed:
            return self._lost(memory, frame, grey, (enough, agree))

        seconds = (frame.time_ns - memory.time_ns) * 1e-9
        rotation_rad, left = rotation_alone((before + now) / 2, now - before, LOSS_PX / camera.fx)
        moves = TRANSLATES.of(camera.fx * median(lengths(left[inliers])), config.min_translation_px)
        if not moves.passed:
            motion = replace(motion, rotation_rad=rotation_rad)
        rate_deg_s = np.degrees(np.linalg.norm(motion.rotation_rad)) / seconds
        decisions = [enough, agree, RESIDUAL.of(median(residuals_px), LOSS_PX), moves]
        decisions.append(RATE.of(rate_deg_s, LEAST_RATE_DEG_S))
        direction, step = memory.direction, np.zeros(3)
        if moves.passed:
            direction = motion.direction
            step = so3_exp(motion.rotation_rad / 2) @ direction
            angle = np.degrees(np.arccos(np.clip(direction[2], -1, 1)))
            decisions.append(HEADING.of(angle, SIDEWAYS_DEG))
        pose = memory.world_from_camera @ Pose.from_rotvec(motion.rotation_rad, step)
        pose = Pose.from_xyzw(pose.xyzw, pose.translation)
        lines = self._lines(start, end, inliers, direction if moves.passed else None)
        after = Memory(grey, frame.time_ns, pose, direction)
        return after, Result(
            pose,
            tuple(decisions),
            residuals_px=residuals_px[inliers],
            lines={"video": lines},
            restarted=memory.restarted,
        )

    def _lost(
        self, memory: Memory, frame: Frame, grey: Image, decisions: tuple[Decision, ...]
    ) -> tuple[Memory | None, Result]:
        """Keeps the last located image for the next frame, or begins again with this one after too many."""
        if memory.lost_frames < self.config.max_lost_frames:
            return replace(memory, lost_frames=memory.lost_frames + 1), Result(decisions=decisions)
        begun = replace(memory, grey=grey, time_ns=frame.time_ns, lost_frames=0, restarted=True)
        return begun, Result(decisions=decisions)

    def _lines(self, start: Array, end: Array, inliers: NDArray[np.bool_], direction: Array | None) -> ImageLines:
        """Returns the vectors (group 0; -1: outliers), and a cross (group 1) where the camera moves to or from."""
        uv, group = np.stack([start, end], axis=1), np.where(inliers, 0, -1)
        camera = self.rig.camera("video")
        if direction is not None and abs(direction[2]) > 0.1:
            focus = camera.project(direction[None] * np.sign(direction[2]))
            if ((focus >= 0) & (focus <= (camera.width, camera.height))).all():
                arms = CROSS_PX * np.array([[[-1.0, 0.0], [1.0, 0.0]], [[0.0, -1.0], [0.0, 1.0]]])
                uv, group = np.concatenate([uv, focus + arms]), np.append(group, [1, 1])
        return ImageLines.of(uv, group)


# Step 1: flow


def flow_vectors(before: Image, now: Image, count: int) -> tuple[Array, Array]:
    """Returns both ends (N, 2), (N, 2) [px] of about `count` consistent vectors of the flow between two images."""
    none = np.zeros((0, 2))
    if before.shape != now.shape or min(now.shape) < MIN_SIDE_PX:
        return none, none
    start = detect_spread(before, count, np.zeros((0, 2), np.float32), MIN_DISTANCE_PX).astype(float)
    if not len(start):
        return none, none
    dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    dis.setFinestScale(0)
    forth, back = (np.asarray(dis.calc(a, b, None)) for a, b in ((before, now), (now, before)))  # type: ignore
    end = start + _at(forth, start)
    circle = lengths(end + _at(back, end) - start)
    patches = (sample(i, (uv[:, None] + PATCH).reshape(-1, 2)) for i, uv in ((before, start), (now, end)))
    similar = correlations(*(patch.reshape(len(start), -1) for patch in patches)) >= MIN_CORRELATION
    good = (circle <= MAX_CIRCLE_PX) & similar
    return start[good], end[good]


def _at(flow: Array, uv: Array) -> Array:
    """Returns the flow (N, 2) at uv (N, 2) [px], bilinear; at the border outside of the image."""
    height, width = flow.shape[:2]
    places = np.clip(uv, 0, (width - 1, height - 1)).astype(np.float32)
    return cv2.remap(flow, places[:, None], None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[:, 0].astype(float)  # type: ignore


# Step 2: egomotion


@cache
def half_sphere() -> Array:
    """Returns directions (DIRECTIONS, 3) with z >= 0, spread evenly (Fibonacci)."""
    k = np.arange(DIRECTIONS) + 0.5
    z, angle = k / DIRECTIONS, np.pi * (1 + np.sqrt(5)) * k
    radius = np.sqrt(1 - z**2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


def by_velocity(x: Array) -> Array:
    """Returns A (N, 2, 3) at normalised x (N, 2): the flow of a point at depth 1 by the velocity of the camera."""
    out = np.zeros((len(x), 2, 3))
    out[:, 0, 0] = out[:, 1, 1] = -1
    out[:, :, 2] = x
    return out


def by_rotation(x: Array) -> Array:
    """Returns B (N, 2, 3) at normalised x (N, 2): the flow by the rotation rates of the camera."""
    u, v = x.T
    rows = [u * v, -(1 + u * u), v], [1 + v * v, -u * v, -u]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def egomotion(x: Array, flow: Array, width: float) -> Motion:
    """Returns direction and rotation from flow (N, 2) at x (N, 2), N >= 8, normalised coordinates.

    `x` is best the middle of each vector: then the equations hold to the second order of the motion. `width`: of the
    robust loss.
    """
    every, b_every = by_velocity(x), by_rotation(x)
    some = np.linspace(0, len(x) - 1, min(len(x), SEARCHED)).astype(int)
    a, b, seen, directions = every[some], b_every[some], flow[some], half_sphere()
    lines = _normals(np.einsum("nij,dj->dni", a, directions))
    turning, along = np.einsum("dni,nij->dnj", lines, b), np.einsum("dni,ni->dn", lines, seen)
    weights = np.ones_like(along)
    for _ in range(SEARCH_ROUNDS):
        weighted = turning * weights[..., None]
        information = np.einsum("dnj,dnk->djk", weighted, turning) + 1e-9 * np.eye(3)
        rotations = np.linalg.solve(information, np.einsum("dnj,dn->dj", weighted, along)[..., None])[..., 0]
        squares = (along - np.einsum("dnj,dj->dn", turning, rotations)) ** 2
        weights = robust_weights(squares, 3 * width)
    costs = np.log1p(squares / width**2).mean(axis=1)
    starts = np.argsort(costs, kind="stable")[:STARTS]
    refined = [_refined(every, b_every, flow, directions[i], rotations[i], width) for i in starts]
    best = min(refined, key=lambda found: float(np.log1p((found.residuals / width) ** 2).mean()))
    towards = np.einsum("ni,nij,j->n", best.translation_flow, every, best.direction)  # positive depth: the same sense
    clear = robust_weights(best.residuals**2, width) * np.tanh(towards / width**2)
    return best if clear.sum() >= 0 else replace(best, direction=-best.direction)


def rotation_alone(x: Array, flow: Array, width: float) -> tuple[Array, Array]:
    """Returns the rotation (3,) that explains most of the flow (N, 2) at x (N, 2), and the flow (N, 2) without it.

    In a narrow view a rotation looks much like a translation to the side. So the translation in a fit of both does not
    show whether there is one; the residuals of a fit of the rotation alone do.
    """
    b, rotation = by_rotation(x), np.zeros(3)
    weights = np.ones(len(x))
    for _ in range(ITERATIONS):
        information = np.einsum("nij,n,nik->jk", b, weights, b) + 1e-12 * np.eye(3)
        rotation = np.linalg.solve(information, np.einsum("nij,n,ni->j", b, weights, flow))
        weights = robust_weights(((flow - b @ rotation) ** 2).sum(axis=1), width)
    return rotation, flow - b @ rotation


def _normals(vectors: Array) -> Array:
    """Returns unit vectors (..., 2) perpendicular to vectors (..., 2); zero where these are."""
    length = np.sqrt((vectors**2).sum(axis=-1, keepdims=True))
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1) / np.maximum(length, 1e-9)


def _refined(a: Array, b: Array, flow: Array, direction: Array, rotation: Array, width: float) -> Motion:
    """Returns the minimum of the robust cost near a direction (3,) and a rotation (3,): Levenberg-Marquardt."""
    damping, (residual, left) = 1e-3, _residuals(a, b, flow, direction, rotation)
    cost = float(np.log1p((residual / width) ** 2).sum())
    for _ in range(ITERATIONS):
        tangent = np.linalg.svd(direction[None])[2][1:]
        towards = a @ direction
        length = np.maximum(np.sqrt((towards**2).sum(axis=1)), 1e-9)
        unit = towards / length[:, None]
        normal = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
        turned = np.einsum("ni,nij,kj->nk", normal, a, tangent) / length[:, None]  # angle of the line by the direction
        along = (unit * left).sum(axis=1)
        jacobian = np.concatenate([-along[:, None] * turned, -np.einsum("ni,nij->nj", normal, b)], axis=1)
        weight = robust_weights(residual**2, width)
        information = np.einsum("ni,n,nj->ij", jacobian, weight, jacobian)
        gradient = np.einsum("ni,n,n->i", jacobian, weight, residual)
        step = -np.linalg.solve(information + damping * np.diag(np.diag(information)) + 1e-15 * np.eye(5), gradient)
        moved = direction + step[:2] @ tangent
        moved, turn = moved / np.linalg.norm(moved), rotation + step[2:]
        new_residual, new_left = _residuals(a, b, flow, moved, turn)
        new_cost = float(np.log1p((new_residual / width) ** 2).sum())
        if new_cost < cost:
            done = cost - new_cost < 1e-9 * cost
            direction, rotation, residual, left, cost = moved, turn, new_residual, new_left, new_cost
            damping = max(damping / 10, 1e-9)
            if done:
                break
        elif damping > 1e6:
            break
        else:
            damping *= 10
    return Motion(direction, rotation, np.abs(residual), left)


def _residuals(a: Array, b: Array, flow: Array, direction: Array, rotation: Array) -> tuple[Array, Array]:
    """Returns distances (N,) from the lines that the direction allows, and the flow (N, 2) without the rotation."""
    left = flow - b @ rotation
    return (_normals(a @ direction) * left).sum(axis=1), left


METHOD = Method(
    "flow", VIDEO, FlowConfig, "own", "Bruss and Horn 1983; Heeger and Jepson 1992",
    checks=CHECKS, stages=STAGES, survey="Table 3, one camera: differential",
)  # fmt: skip
