"""What is measured at each stage: exact truth first, then one mistake at a time."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from ispom_app.features.grading.command import seeds
from ispom_app.features.grading.measure import Measured, Views, drift, interpolated
from ispom_app.features.grading.points import STAGES, graded, total

from ispom.geometry import Array, Pose
from ispom.sequences.address import MAX_SEED
from ispom.sequences.formats.simulated import rendered_source
from ispom.simulation.truth import Truth
from ispom.types import FrameName, Landmarks, Status, Step, Tracks, Trajectory

STEP_NS, COUNT = 100_000_000, 12


def test_depth_is_exact_on_a_plane_and_unknown_at_an_edge() -> None:
    v, u = np.mgrid[0:20, 0:30].astype(float)
    depth = 1 / (0.1 + 0.001 * u + 0.002 * v)
    uv = np.array([[3.3, 4.7], [28.9, 18.2], [-0.1, 3.0], [29.5, 3.0]])
    found = interpolated(depth, uv)
    np.testing.assert_allclose(found[:2], 1 / (0.1 + 0.001 * uv[:2, 0] + 0.002 * uv[:2, 1]), rtol=1e-12)
    assert np.isnan(found[2:]).all()
    depth[:, 15:] *= 2
    assert np.isnan(interpolated(depth, np.array([[14.5, 5.0]]))).all()
    depth[5, 5] = np.inf
    assert np.isnan(interpolated(depth, np.array([[4.5, 5.0]]))).all()


class Remembered(Truth):
    """The same, whose depths are computed once."""

    @cache  # noqa: B019 (a few, of one truth)
    def depth(self, name: FrameName, time_ns: int) -> Array:
        return super().depth(name, time_ns)


class Perfect:
    """Steps that are the truth: points of the first frame, where they are seen in the others."""

    def __init__(self) -> None:
        source = rendered_source("sim:tiny", 3)
        assert source is not None
        self.truth, self.rig = Remembered(source), source.rig
        self.camera = self.truth.camera("video")
        u, v = np.meshgrid(np.linspace(60, 260, 12), np.linspace(40, 200, 10))
        uv = np.column_stack([u.ravel(), v.ravel()])
        depth = interpolated(self.truth.depth("video", 0), uv)
        uv, depth = uv[depth < 60], depth[depth < 60]
        rays = np.column_stack([self.camera.normalise(uv), np.ones(len(uv))])
        self.world = self.truth.pose("video", 0)
        self.xyz = rays * depth[:, None]  # in the first camera, which is the method's world
        self.ids = np.arange(len(uv))

    def step(self, k: int) -> Step:
        pose = self.world.inverse() @ self.truth.pose("video", k * STEP_NS)
        uv = self.camera.project(pose.inverse().apply(self.xyz))
        tracks = {"video": Tracks.of(self.ids, uv)}
        points = Landmarks(self.ids, self.xyz, np.zeros((len(self.ids), 3), np.uint8))
        return Step(k * STEP_NS, Status.TRACKING, "video", pose, tracks=tracks, landmarks=points)

    def values(self, steps: list[Step]) -> dict[str, float | None]:
        return self.measured(steps)[0]

    def measured(self, steps: list[Step]) -> tuple[dict[str, float | None], dict[str, float]]:
        """Values, and the bounds of those that are too good."""
        views = Views(self.truth, self.rig.rig_from, False)
        for k, step in enumerate(steps):
            views.add(k, step)
        poses = [(s.time_ns, s.world_from_frame) for s in steps if s.world_from_frame is not None]
        true = [(k * STEP_NS, self.truth.pose("video", k * STEP_NS)) for k in range(len(steps))]
        values = views.values(Trajectory.of(poses, "video"), Trajectory.of(true, "video"))[0]
        return values, views.too_good(values)


@pytest.fixture(scope="module")
def perfect() -> Perfect:
    return Perfect()


@pytest.fixture(scope="module")
def steps(perfect: Perfect) -> list[Step]:
    return [perfect.step(k) for k in range(COUNT)]


def points_of(values: dict[str, float | None]) -> dict[str, float]:
    return {stage.name: sum(r.points for r in results) for stage, results in graded([Measured(0, values)])}


def test_the_truth_has_all_points_that_its_number_of_tracks_allows(perfect: Perfect, steps: list[Step]) -> None:
    values = perfect.values(steps)
    assert values["turn_deg"] == pytest.approx(0, abs=1e-4) and values["direction_deg"] == pytest.approx(0, abs=1e-4)
    assert values["reprojection_px"] == pytest.approx(0, abs=1e-4) and values["ate_percent"] == pytest.approx(
        0, abs=1e-6
    )
    assert values["wrong_percent"] == pytest.approx(0, abs=1e-6) and values["located_percent"] == 100
    assert values["depth_percent"] < 3 and values["scale_percent"] == pytest.approx(0, abs=1e-6)
    assert total(graded([Measured(0, values)])) > 95


def test_the_truth_itself_is_too_good(perfect: Perfect, steps: list[Step]) -> None:
    assert {"ate_percent", "turn_deg", "reprojection_px"} <= perfect.measured(steps)[1].keys()
    rng = np.random.default_rng(0)
    real = [
        replace(
            s,
            world_from_frame=s.world_from_frame @ Pose.from_rotvec(rng.normal(0, 1e-4, 3), rng.normal(0, 1e-4, 3)),  # type: ignore[operator]
            tracks={"video": replace(t, uv=t.uv + rng.normal(0, 0.03, t.uv.shape).astype(np.float32))},
        )
        for s in steps
        for t in [s.tracks["video"]]
    ]
    assert perfect.measured(real)[1] == {}, "a tenth of the best method's noise is no alarm"


def test_tracks_are_judged_by_all_of_them(perfect: Perfect, steps: list[Step]) -> None:
    """Three real tracks, and 150 points with ids that are new in each frame, or after three of them."""
    rng = np.random.default_rng(0)
    best = points_of(perfect.values(steps))["tracking"]
    still = rng.uniform((0, 0), (319, 239), (150, 2))
    for places in (lambda k: rng.uniform((0, 0), (319, 239), (150, 2)), lambda k: still):
        for frames in (1, 3):
            cheat = []
            for k, step in enumerate(steps):
                real, ids = step.tracks["video"], 10**6 + 150 * (k // frames) + np.arange(150)
                tracks = Tracks.of(np.concatenate([real.ids[:3], ids]), np.concatenate([real.uv[:3], places(k)]))
                cheat.append(replace(step, tracks={"video": tracks}, landmarks=Landmarks.empty()))
            assert points_of(perfect.values(cheat))["tracking"] < 4 < best


def test_copies_of_one_track_are_one_track(perfect: Perfect, steps: list[Step]) -> None:
    copies = []
    for step in steps:
        uv = np.repeat(step.tracks["video"].uv[:1], 150, axis=0)
        xyz = np.repeat(step.landmarks.xyz_in_world[:1], 150, axis=0)
        landmarks = Landmarks(np.arange(150), xyz, np.zeros((150, 3), np.uint8))
        copies.append(replace(step, tracks={"video": Tracks.of(np.arange(150), uv)}, landmarks=landmarks))
    found = points_of(perfect.values(copies))
    assert found["tracking"] < 2 and found["triangulation"] == 0


def test_a_trajectory_of_a_few_chosen_frames_has_no_error_that_counts(perfect: Perfect, steps: list[Step]) -> None:
    few = [replace(s, world_from_frame=None) if k > COUNT // 3 else s for k, s in enumerate(steps)]
    assert "ate_percent" not in perfect.values(few)


def test_a_unit_of_its_own_loses_nothing(perfect: Perfect, steps: list[Step]) -> None:
    small = [
        replace(
            step,
            world_from_frame=step.world_from_frame.scaled(0.1),  # type: ignore[union-attr]
            landmarks=replace(step.landmarks, xyz_in_world=0.1 * step.landmarks.xyz_in_world),
        )
        for step in steps
    ]
    assert points_of(perfect.values(small)) == pytest.approx(points_of(perfect.values(steps)), abs=1e-6)


def test_each_mistake_costs_points_at_its_stage(perfect: Perfect, steps: list[Step]) -> None:
    best = points_of(perfect.values(steps))
    rng = np.random.default_rng(0)

    def worse(changed: list[Step]) -> set[str]:
        found = points_of(perfect.values(changed))
        return {name for name, points in found.items() if points < best[name] - 1}

    slipped = [
        replace(s, tracks={"video": replace(t, uv=t.uv + np.float32(4 * k))}, landmarks=Landmarks.empty())
        for k, s in enumerate(steps)
        for t in [s.tracks["video"]]
    ]
    assert "tracking" in worse(slipped)
    far = rng.uniform(0.5, 2, len(perfect.ids))[:, None]
    deep = [replace(s, landmarks=replace(s.landmarks, xyz_in_world=far * s.landmarks.xyz_in_world)) for s in steps]
    assert "triangulation" in worse(deep) and "two-view" not in worse(deep)
    turned = Pose.from_rotvec(np.array([0.0, 0.2, 0.0]), np.zeros(3))
    turns = [replace(s, world_from_frame=s.world_from_frame @ turned) if k % 2 else s for k, s in enumerate(steps)]  # type: ignore[operator]
    assert {"two-view", "resection"} <= worse(turns)
    grown = [replace(s, world_from_frame=s.world_from_frame.scaled(1 + k / COUNT)) for k, s in enumerate(steps)]  # type: ignore[union-attr]
    assert "scale" in worse(grown)
    lost = [replace(s, world_from_frame=None, status=Status.LOST) if k > 4 else s for k, s in enumerate(steps)]
    assert "resection" in worse(lost)
    assert worse([replace(s, world_from_frame=None, status=Status.INITIALISING) for s in steps]) >= {
        "two-view",
        "scale",
    }


def test_points_are_a_hundred_and_a_failed_run_has_none() -> None:
    assert sum(part.points for stage in STAGES for part in stage.parts) == 100
    full = {part.key: part.full for stage in STAGES for part in stage.parts}
    zero = {part.key: part.zero for stage in STAGES for part in stage.parts}
    assert total(graded([Measured(0, full)])) == 100 and total(graded([Measured(0, zero)])) == 0
    assert total(graded([Measured(0, full), Measured(1, {}, failure="it ends")])) == 50
    assert total(graded([Measured(0, {**full, "ate_percent": float("nan")})])) == 95


def test_a_unit_that_does_not_move_has_no_drift() -> None:
    times = np.arange(20) * STEP_NS
    moving = np.column_stack([np.arange(20.0), np.zeros((20, 2))])
    still = Trajectory(times, np.tile(np.eye(3), (20, 1, 1)), np.zeros((20, 3)))
    assert drift(still, replace(still, translations=moving)) is None
    halved = replace(still, translations=np.where(np.arange(20)[:, None] > 10, (moving + 10) / 2, moving))
    assert drift(halved, replace(still, translations=moving)) == pytest.approx(100 * np.log(2), rel=1e-6)


def test_seeds_depend_on_the_key_alone() -> None:
    assert seeds("a", 3) == seeds("a", 5)[:3] != seeds("b", 3)
    assert len(set(seeds("a", 50))) == 50 and all(0 <= seed <= MAX_SEED for seed in seeds("a", 50))
