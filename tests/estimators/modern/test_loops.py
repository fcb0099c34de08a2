"""A place that is seen again corrects all poses; where houses look alike, and where nothing returns, nothing does."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from ispom.estimators.modern.loops import nodes as nodes_module
from ispom.estimators.modern.loops.depths import surroundings
from ispom.estimators.modern.loops.find import SINGLE_DRIFT as SINGLE_DRIFT_SHARE
from ispom.estimators.modern.loops.find import agreeing, possible
from ispom.estimators.modern.loops.loops import KeyFrameSeen, Known, Loops, covariance_at, seen_again
from ispom.estimators.modern.loops.nodes import Loop, Node, edges_of, step_between, thinned, with_poses
from ispom.estimators.modern.loops.output_correction import AT_ONCE, Correction, next_range
from ispom.estimators.modern.loops.relative_pose import DescribedPoints, LoopCamera, relative_pose
from ispom.estimators.modern.stereo.estimator import ModernStereoConfig
from ispom.geometry import Pose, Similarity, so3_exp
from ispom.simulation.cameras import simulated_rig
from ispom.simulation.places.town import LAP_M, SPEED_M_S, build_town, on_route
from ispom.simulation.rendering.renderer import Renderer, exposed
from ispom.simulation.source import NOISE_SIGMA
from ispom.types import Frame
from tests.estimators.modern.loop_bench import CAMERA, STEP_M, Driven, Facades, driven, wrong

SINGLE = replace(CAMERA, baseline=0.0)
SINGLE_DRIFT = 0.4
"""One camera's depths are met between its nodes, 4 m apart: with 0.05 degrees from one to the next, as odometry has."""
TERRACE_M = 12.0


def closed(found: Driven) -> bool:
    return bool(found.loops.closed)


@pytest.mark.parametrize("camera", [CAMERA, SINGLE], ids=["pair", "single"])
@pytest.mark.parametrize("seed", range(2))
def test_a_lap_ends_where_it_began(camera: LoopCamera, seed: int) -> None:
    """541 m: 0.1 % at the return, of one to three metres without the loop."""
    found = driven(Facades.seeded(seed), 1.06 * LAP_M, seed, camera, 1.0 if camera.baseline else SINGLE_DRIFT)
    before, after = found.ends
    assert closed(found) and not wrong(found)
    assert after < 0.001 * 1.06 * LAP_M < before


@pytest.mark.parametrize(
    ("camera", "keys", "seeds"),
    [pytest.param(CAMERA, 1, (1,), id="pair"), pytest.param(SINGLE, 2, (1, 2), id="single", marks=pytest.mark.slow)],
)
def test_a_stretch_that_began_blindly_is_put_right_and_the_rest_stays(
    camera: LoopCamera, keys: int, seeds: tuple[int, ...]
) -> None:
    """A stretch is put right as well as odometry over the lap is known: to 1 m of 3, of one camera on average."""
    begun, drift, worst = 50, 1.0 if camera.baseline else SINGLE_DRIFT, list[float]()
    blind = begun + keys - 1
    for seed in seeds:
        found = driven(Facades.seeded(seed), 1.06 * LAP_M, seed, camera, drift, begun, keys)
        assert closed(found) and found.ends[1] < 0.001 * 1.06 * LAP_M
        off = {
            n.time_ns: float(np.linalg.norm(n.corrected.pose.translation - found.truth[n.time_ns].translation))
            for n in found.loops.nodes
        }
        worst.append(max(off[t] for t in off if t >= blind))
        follows = Correction.of(found.loops).follows[sorted(off).index(blind)]
        assert not follows, "no pose is between the two stretches"
    assert np.mean(worst) < 1.0, "of 3 m"


@pytest.mark.parametrize(("camera", "scale"), [(CAMERA, 1.0), (SINGLE, 3.0)], ids=["pair", "single"])
def test_a_segment_that_begins_anywhere_joins_the_one_that_it_sees_again(camera: LoopCamera, scale: float) -> None:
    keys, drift = (1, 1.0) if camera.baseline else (2, SINGLE_DRIFT)
    found = driven(Facades.seeded(1), 1.06 * LAP_M, 1, camera, drift, 50, keys, blind_m=200.0, blind_scale=scale)
    assert closed(found) and not wrong(found)
    assert {n.segment for n in found.loops.nodes} == {0}
    last = found.loops.nodes[-1]
    assert np.linalg.norm(last.corrected.pose.translation - found.truth[last.time_ns].translation) < 1.0, "of 200 m"


def test_without_noise_the_relative_pose_of_two_keyframes_is_exact() -> None:
    rng = np.random.default_rng(0)
    facades = Facades.seeded(0)
    first, then = (facades.seen_from(Pose(translation=np.array([x, 0.0, 10.0 + x])), rng) for x in (0.0, 1.0))
    found = relative_pose(CAMERA, first, then)
    assert found is not None
    off = found.first_from_then.pose.translation - (1.0, 0.0, 1.0)
    assert np.linalg.norm(off) < 3 * np.sqrt(np.trace(found.covariance[:3, :3])) < 0.2
    nowhere = facades.seen_from(Pose(translation=np.array([0.0, 0.0, 90.0])), rng)
    assert relative_pose(CAMERA, first, nowhere) is None


def test_what_is_seen_around_a_place_is_where_it_is_from_there() -> None:
    """By steps of odometry that is exact; not across a blind start, nor farther than two nodes."""
    rng, facades = np.random.default_rng(0), Facades.seeded(0)
    poses = [on_route(STEP_M * i) for i in range(7)]
    sights = [facades.seen_from(pose, rng) for pose in poses]
    exact = [replace(s, xyz=np.column_stack([s.x, np.ones(len(s.x))]).astype(np.float32)) for s in sights]
    nodes = tuple(
        Node(i, max(i - 1, 0), pose, np.zeros((6, 6)), 0.0, STEP_M * i, Similarity(1.0, pose), sight, connected=i != 5)
        for i, (pose, sight) in enumerate(zip(poses, exact, strict=True))
    )
    found = surroundings(nodes, nodes[4])
    # Those of itself and of the two before: the next one began blindly.
    wanted = [poses[4].inverse().apply(poses[i].apply(exact[i].xyz.astype(float))) for i in (4, 3, 2)]
    np.testing.assert_allclose(found.xyz, np.concatenate(wanted), atol=1e-4)
    assert len(surroundings(nodes, nodes[2]).x) == sum(len(exact[i].x) for i in range(5))


def test_one_camera_turned_away_knows_a_place_by_what_lies_around_it() -> None:
    """Of a tenth of the depths a node by itself shows too little again."""
    rng, facades = np.random.default_rng(0), Facades.seeded(0)
    poses = [on_route(20.0 + STEP_M * i) for i in range(5)]
    turned = poses[2] @ Pose(so3_exp(np.array([0.0, np.radians(25.0), 0.0])), np.array([0.5, 0.0, 1.0]))
    sights = [facades.seen_from(pose, rng) for pose in poses]
    few = [replace(s, xyz=np.where(rng.uniform(size=(len(s.x), 1)) < 0.1, s.xyz, np.nan)) for s in sights]
    nodes = tuple(
        Node(i, max(i - 1, 0), pose, np.zeros((6, 6)), 0.0, STEP_M * i, Similarity(1.0, pose), sight)
        for i, (pose, sight) in enumerate(zip(poses, few, strict=True))
    )
    then = facades.seen_from(turned, rng)
    assert relative_pose(SINGLE, few[2], then) is None
    found = relative_pose(SINGLE, surroundings(nodes, nodes[2]), then, together=True)
    assert found is not None
    off = found.first_from_then.pose.translation - (poses[2].inverse() @ turned).translation
    assert np.linalg.norm(off) < 4 * np.sqrt(np.trace(found.covariance[:3, :3])) < 0.4


def test_a_view_that_is_surer_than_right_is_no_view_of_the_same_loop() -> None:
    """Half a metre off where it claims centimetres: within all that is held possible, but not of what it claims."""
    nodes = chain(40)
    at = {n.time_ns: n for n in nodes}
    sure = np.diag([0.02**2] * 3 + [0.002**2] * 3 + [0.01**2])

    def seen(a: int, b: int, off: float, times_as_sure: float = 1.0) -> Loop:
        way = at[a].odometry.inverse() @ at[b].odometry @ Pose(translation=np.array([off, 0.0, 0.0]))
        return Loop(a, b, Similarity(1.0, way), sure / times_as_sure**2)

    good, bad = (seen(1, 36, 0.0), seen(2, 37, 0.01), seen(3, 39, -0.01)), seen(2, 38, 0.5)
    every = (*good[:2], bad, good[2])
    assert agreeing(nodes, every, good[2], SINGLE_DRIFT_SHARE) == good
    assert agreeing(nodes, every, bad, SINGLE_DRIFT_SHARE) == (bad,)
    vague = seen(4, 39, 0.2, 0.05)
    assert agreeing(nodes, (bad, vague), vague, SINGLE_DRIFT_SHARE) == (bad, vague), "which contradicts neither"
    assert agreeing(nodes, (*every, vague), vague, SINGLE_DRIFT_SHARE) == (*good, vague), "and vouches for none"


@pytest.mark.parametrize("seed", range(2))
def test_rows_of_equal_houses_are_no_loop(seed: int) -> None:
    """Of a tenth of a lap less than one, past one house over and over: what looks like the start is not it."""
    found = driven(Facades.seeded(seed, TERRACE_M), 0.9 * LAP_M, seed)
    assert not closed(found)
    assert found.ends[0] == found.ends[1]


@pytest.mark.slow
@pytest.mark.parametrize("camera", [CAMERA, SINGLE], ids=["pair", "single"])
def test_twenty_seeds(camera: LoopCamera) -> None:
    """Found in 19 of 20 at least; of 20 routes by equal houses without a loop none is one, and no loop is wrong."""
    drift = 1.0 if camera.baseline else SINGLE_DRIFT
    laps = [driven(Facades.seeded(s), 1.06 * LAP_M, s, camera, drift) for s in range(20)]
    assert sum(closed(f) and f.ends[1] < 0.001 * 1.06 * LAP_M for f in laps) >= 19
    assert not sum(wrong(f) for f in laps)
    rows = [driven(Facades.seeded(s, TERRACE_M), 0.9 * LAP_M, s, camera, drift) for s in range(20)]
    assert not any(closed(f) for f in rows)


def blank() -> DescribedPoints:
    return DescribedPoints(
        np.zeros((1, 2), np.float32),
        np.zeros((1, 128), np.uint8),
        np.full((1, 3), 10, np.float32),
        np.zeros((30, 40), np.float32),
        10.0,
    )


def chain(count: int) -> tuple[Node, ...]:
    """Odometry with a turn of its own, and no loop."""
    found, sight = list[Node](), blank()
    for i in range(count):
        pose = on_route(4.0 * i)
        unsure = np.diag([1e-4 * i] * 3 + [1e-6 * i] * 3)
        corrected = Similarity(1.0, pose)
        found.append(Node(i, max(i - 1, 0), pose, unsure, 0.0, 4.0 * i, corrected, sight))
    return tuple(found)


def test_thinned_nodes_keep_what_was_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(nodes_module, "MAX_NODES", 40)
    monkeypatch.setattr(nodes_module, "RECENT", 8)
    nodes = chain(60)
    at = {n.time_ns: n for n in nodes}
    loops = tuple(
        Loop(a, b, Similarity(1.0, at[a].odometry.inverse() @ at[b].odometry), 1e-4 * np.eye(7))
        for a, b in ((0, 30), (5, 31), (6, 32), (7, 33))
    )
    kept, moved = nodes[:34], loops
    for node in nodes[34:]:
        kept, moved = thinned((*kept, node), moved)
    assert len(kept) == 40 and kept[0] is nodes[0] and kept[-8:] == nodes[-8:]
    assert moved and {x.first_ns for x in moved} | {x.then_ns for x in moved} <= {n.time_ns for n in kept}
    for edge in edges_of(kept, moved):
        true = kept[edge.first].odometry.inverse() @ kept[edge.then].odometry
        np.testing.assert_allclose(edge.first_from_then.pose.matrix, true.matrix, atol=1e-9)
    steps = [step_between(b, n)[1][0, 0] for b, n in pairwise(kept)]
    assert min(steps) > 0


def test_a_window_that_slides_bends_no_way() -> None:
    """All that is in it moves alike as the unit and the heading become known; what has left it stays."""
    nodes, slide = chain(12), Pose(translation=np.array([0.5, 0.0, 0.0]))
    nodes = with_poses(nodes, {n.time_ns: n.odometry for n in nodes}, None)
    window = {n.time_ns: slide @ n.odometry for n in nodes[8:]}
    plain, closed = with_poses(nodes, window, None), with_poses(nodes, window, 10)
    for (a, b), (c, d), (e, f) in zip(pairwise(nodes), pairwise(plain), pairwise(closed), strict=True):
        before = step_between(a, b)[0].pose.matrix
        np.testing.assert_allclose(step_between(c, d)[0].pose.matrix, before, atol=1e-12)
        np.testing.assert_allclose(step_between(e, f)[0].pose.matrix, before, atol=1e-12)
    # Without a loop poses are those of odometry; with one they stay where the graph, and the steps since, put them.
    np.testing.assert_allclose(plain[-1].correction.pose.matrix, np.eye(4), atol=1e-12)
    for node, was in zip(closed, nodes, strict=True):
        np.testing.assert_allclose(node.corrected.pose.matrix, was.corrected.pose.matrix, atol=1e-12)


def test_a_step_is_that_of_the_last_window_with_both_its_ends() -> None:
    first, then = chain(2)
    together = {0: first.odometry, 1: first.odometry @ Pose(translation=np.array([0.0, 0.0, 5.0]))}
    nodes = with_poses((first, then), together, None)
    # The earlier one has left: the later one slides alone.
    nodes = with_poses(nodes, {1: Pose(translation=np.array([1.0, 0.0, 0.0])) @ together[1]}, None)
    np.testing.assert_allclose(step_between(*nodes)[0].pose.translation, (0.0, 0.0, 5.0), atol=1e-12)


def test_odometry_can_have_lost_its_unit_but_not_its_place_alone() -> None:
    nodes = chain(60)
    first, then = nodes[0], nodes[-1]
    way = Similarity(1.0, first.odometry.inverse() @ then.odometry)
    aside = Similarity(1.0, Pose(translation=np.array([0.1 * then.path, 0.0, 0.0])))
    assert possible(first, then, way, SINGLE_DRIFT_SHARE)
    assert not possible(first, then, way @ aside, SINGLE_DRIFT_SHARE)
    assert possible(first, then, way @ aside @ Similarity(np.exp(0.3)), SINGLE_DRIFT_SHARE)
    assert not possible(first, then, way @ aside @ Similarity(np.exp(0.1)), SINGLE_DRIFT_SHARE)


def test_between_nodes_the_correction_is_between_theirs() -> None:
    nodes = chain(3)
    shifted = [replace(n, corrected=Similarity(1.0 + i, n.corrected.pose)) for i, n in enumerate(nodes)]
    found = Correction.of(Loops(tuple(shifted), (Loop(0, 2, Similarity(), np.eye(7)),)))
    for node, corrected in zip(nodes, shifted, strict=True):
        np.testing.assert_allclose(
            found.applied(node.time_ns, node.odometry).translation, corrected.corrected.pose.translation, atol=1e-9
        )
    # A start that nothing joins to what was before takes nothing over from there.
    alone = [*shifted[:2], replace(shifted[2], parent_ns=0)]
    apart = Correction.of(Loops(tuple(alone), (Loop(0, 2, Similarity(), np.eye(7)),)))
    assert apart.follows == (False, True, False)


def test_how_sure_a_pose_is_follows_its_window_as_that_is_adjusted() -> None:
    nodes = chain(40)
    adjusted = 0.1 * np.eye(7)
    loops = Loops(nodes, (Loop(0, 39, Similarity(), np.eye(7)),), known=Known(nodes[-1], adjusted))
    moved = nodes[-1].odometry @ Pose(translation=np.array([3.0, 0.0, 0.0]))
    last = nodes[-1]
    key = KeyFrameSeen(40, moved, last.covariance, 0.0, {39: moved, 40: moved}, blank)
    loops, _ = seen_again(loops, CAMERA, key, 41)
    np.testing.assert_allclose(covariance_at(loops, moved, last.covariance, 0.0), adjusted, atol=1e-5)


def test_all_poses_are_told_again_a_bounded_number_at_a_time() -> None:
    loops, told = Loops(uncorrected=450, corrected_to=450, end=450), list[int]()
    while loops.uncorrected:
        loops, some = next_range(loops, 450)
        assert len(some) <= AT_ONCE
        told += some
    assert sorted(told) == list(range(450))
    # A loop in the middle of it: all are told once more, from where it was on, and around, as more poses come.
    loops, some = next_range(Loops(uncorrected=450, corrected_to=450, end=450), 450)
    loops, told, poses = replace(loops, uncorrected=460, end=460), [], 460
    while loops.uncorrected:
        loops, some = next_range(loops, poses)
        told += some
        poses += 1
    assert sorted(told) == list(range(460))


@pytest.mark.slow
def test_a_rendered_lap_comes_back_to_its_start() -> None:
    """The town at half size, 2 m between pairs: the same poses with loops off, and to 0.1 % of 541 m with them."""
    rig, renderer = simulated_rig(0.5), Renderer(build_town(0))
    on, off = (ModernStereoConfig(loops=loops).build(rig) for loops in (True, False))
    state, plain = on.start(), off.start()
    truth, shift = [], list[float]()
    for i in range(int(1.06 * LAP_M / 2)):
        pose = on_route(2.0 * i) @ Pose(translation=np.array([0.3 * np.sin(i / 9), -1.75, 0.0]))
        truth.append(pose)
        images = []
        for name in ("left", "right"):
            sharp = renderer.image(rig.camera(name), pose @ rig.rig_from(name), 1)
            images.append(exposed(sharp, 1000 * i + len(name), NOISE_SIGMA))
        pair = Frame.stereo(round(2e9 * i / SPEED_M_S), *images)
        state, step = on.step(state, pair)
        plain, other = off.step(plain, pair)
        assert step.world_from_frame is not None and other.world_from_frame is not None
        shift += [d.value for d in step.decisions if d.key == "loop_shift"]
        if not shift:
            assert np.array_equal(step.world_from_frame.matrix, other.world_from_frame.matrix)
    assert shift
    true = (truth[0].inverse() @ truth[-1]).translation
    with_loops, without = (
        float(np.linalg.norm(e.finish(s).translations[-1] - true)) for e, s in ((on, state), (off, plain))
    )
    assert with_loops < min(0.001 * 1.06 * LAP_M, without)
