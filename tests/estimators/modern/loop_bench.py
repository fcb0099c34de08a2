"""Routes between facades without images: described points where the walls are, odometry that drifts, and its loops."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ispom.estimators.modern.loops.asked import NOTHING_ASKED, Asked
from ispom.estimators.modern.loops.loops import KeyFrameSeen, Loops, seen_again
from ispom.estimators.modern.loops.relative_pose import DescribedPoints, LoopCamera
from ispom.features.sift import SIFT_MATCHER
from ispom.geometry import Array, Pose
from ispom.simulation.places.town import SIDE_M, on_route, streets
from ispom.types import Decision

STEP_M = 4.0
CAMERA = LoopCamera(460.0, np.array([-0.69, -0.52]), np.array([0.69, 0.52]), 1 / 460.0, SIFT_MATCHER, 0.4)
FARTHEST_M = 40.0
SHOWN = 500


@dataclass(frozen=True, eq=False)
class Facades:
    """Points on the walls of the town's streets, 8 m from their middle."""

    xyz: Array
    descriptors: Array
    """(N, 128) of length 1."""

    @staticmethod
    def seeded(seed: int, period_m: float = 0.0) -> Facades:
        """`period_m`: length of a house; all houses along the streets are the same. 0: no two points are the same."""
        rng = np.random.default_rng(seed)
        count, one = 400, 700 if period_m else 0
        house = _unit(rng.uniform(size=(one, 128)) ** 4)
        house_at = rng.uniform((0, -9, -1), (period_m or 1, 2, 1), (one, 3)) if one else np.zeros((0, 3))
        places, words = [], []
        for street in streets():
            if one:
                for k in range(int(SIDE_M / period_m)):
                    for side in (-8.0, 8.0):
                        mine = (house_at[:, 2] > 0) == (side > 0)
                        along = house_at[mine, 0] + k * period_m
                        here = np.column_stack([np.full(len(along), side), house_at[mine, 1], along])
                        use = rng.uniform(size=len(here)) < 0.8
                        places.append(street.apply(here[use]))
                        words.append(house[mine][use])
            else:
                side = np.where(rng.uniform(size=8 * count) < 0.5, -8.0, 8.0)
                here = np.column_stack([side, rng.uniform(-9, 2, len(side)), rng.uniform(-20, SIDE_M + 20, len(side))])
                places.append(street.apply(here))
                words.append(_unit(rng.uniform(size=(len(here), 128)) ** 4))
        return Facades(np.concatenate(places), np.concatenate(words))

    def seen_from(self, world_from_camera: Pose, rng: np.random.Generator) -> DescribedPoints:
        """With a pixel of noise, 3 % of depth, and descriptors that are a little different each time."""
        near = world_from_camera.inverse().apply(self.xyz)
        x = CAMERA.in_sight(near)
        seen = np.flatnonzero(np.isfinite(x[:, 0]) & (near[:, 2] < FARTHEST_M))
        seen = np.sort(rng.permutation(seen)[:SHOWN])
        depth = near[seen, 2] * (1 + 0.03 * rng.standard_normal(len(seen)))
        x = x[seen] + CAMERA.sigma * 0.7 * rng.standard_normal((len(seen), 2))
        words = _unit(np.abs(self.descriptors[seen] + 0.02 * rng.standard_normal((len(seen), 128))))
        xyz = np.column_stack([x, np.ones(len(x))]) * depth[:, None]
        looks = np.zeros((30, 40), np.float32)
        return DescribedPoints(
            x.astype(np.float32), np.rint(255 * words).astype(np.uint8), xyz.astype(np.float32), looks, depth=15.0
        )


@dataclass(frozen=True, eq=False)
class Driven:
    loops: Loops
    decisions: tuple[Decision, ...]
    truth: tuple[Pose, ...]
    odometry: tuple[Pose, ...]

    @property
    def ends(self) -> tuple[float, float]:
        """Error at the end without and with the loops [m], in the unit at the start."""
        true = self.truth[-1].translation
        found = self.loops.correction.apply_pose(self.odometry[-1])
        return tuple(float(np.linalg.norm(p.translation - true)) for p in (self.odometry[-1], found))  # type: ignore


def driven(
    facades: Facades,
    length_m: float,
    seed: int,
    camera: LoopCamera = CAMERA,
    drift: float = 1.0,
    blind_at: int = -1,
    begun_with: int = 1,
    blind_m: float = 3.0,
    blind_scale: float = 1.0,
    asked: Asked = NOTHING_ASKED,
) -> Driven:
    """Along the route, with key frames STEP_M apart; of one camera (no baseline) the unit drifts as well.

    At node `blind_at` nothing joins it to those before: it is put `blind_m` beside, believed to be known to 3 m,
    and its unit is another one by `blind_scale`. What begins there is
    told of when there are as many key frames as it is begun with: the first map of one camera has several.
    """
    begins = blind_at + begun_with - 1
    rng = np.random.default_rng([seed, 7])
    truth = [on_route(along) for along in np.arange(0.0, length_m, STEP_M)]
    truth = [truth[0].inverse() @ pose for pose in truth]
    world = Facades(on_route(0.0).inverse().apply(facades.xyz), facades.descriptors)
    single, loops, told = not camera.baseline, Loops(), tuple[Decision, ...]()
    odometry, unit = [truth[0]], 1.0
    turn = drift * np.radians(0.12) * np.array([0.2, 1.0, 0.2])
    noise = np.concatenate([np.full(3, 0.01 * drift), turn])
    covariance = np.zeros((6, 6))
    for i, pose in enumerate(truth):
        if i:
            unit *= float(np.exp(0.004 * drift * rng.standard_normal())) if single else 1.0
            step = (truth[i - 1].inverse() @ pose) @ Pose.exp(noise * rng.standard_normal(6))
            if i == blind_at:
                step = step @ Pose(translation=np.array([blind_m, 0.0, 0.0]))
                unit *= blind_scale
            odometry.append(odometry[-1] @ step.scaled(unit))
            back = step.scaled(unit).inverse().adjoint
            covariance = back @ covariance @ back.T + np.diag((noise * [*[unit] * 3, 1, 1, 1]) ** 2)
        if i == blind_at:
            covariance = covariance + np.diag([3.0**2] * 3 + [1e-4] * 3)
        seen = world.seen_from(pose, rng)
        if single:
            # Its depths are met between nodes, from the odometry.
            seen = replace(seen, xyz=np.full_like(seen.xyz, np.nan), depth=unit * seen.depth)
        window = {k: odometry[k] for k in range(max(i - 3, 0, blind_at * (i >= blind_at)), i + 1)}
        variance = i * (0.004 * drift) ** 2 if single else 0.0
        key = KeyFrameSeen(
            i, odometry[-1], covariance, variance, window, lambda seen=seen: seen, joined=blind_at < 0 or i != begins
        )
        loops, new = seen_again(loops, camera, None if blind_at <= i < begins else key, i + 1, asked)
        told += new
        for _ in range(3):
            loops, new = seen_again(loops, camera, None, i + 1, asked)
            told += new
    return Driven(loops, told, tuple(truth), tuple(odometry))


def wrong(found: Driven) -> int:
    """Loops, closed or only proposed, that are off by more than a metre or two degrees."""
    count = 0
    for loop in (*found.loops.closed, *found.loops.proposed):
        true = found.truth[loop.first_ns].inverse() @ found.truth[loop.then_ns]
        unit = float(np.linalg.norm(true.translation)) / max(
            float(np.linalg.norm(loop.first_from_then.pose.translation)), 1e-9
        )
        measured = loop.first_from_then.pose.scaled(unit if abs(unit - 1) < 0.5 else 1.0)
        off = true.inverse() @ measured
        count += float(np.linalg.norm(off.translation)) > 1.0 or float(np.degrees(np.linalg.norm(off.rotvec))) > 2.0
    return count


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=1, keepdims=True)
