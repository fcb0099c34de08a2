"""Routes that return, without images: what a loop does to the drift of a chain, exact truth first and then noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.geometry import Array, Pose, Similarity, rotation_angle_rad
from ispom.solvers.pose_graph import FREEDOM, Edge, adjoint_sim3, joined, optimise, reversed_edge

COUNT = 100
TIGHT = np.diag([1e-4] * 3 + [1e-8] * 3 + [1e-8])


def block(count: int = COUNT, side: float = 75.0) -> tuple[Similarity, ...]:
    """Around a block of four streets, looking ahead, and a little up and down: back where it began."""
    found = []
    for i in range(count):
        corner, along = divmod(4 * i / (count - 1), 1)
        turn = Pose.from_rotvec(np.array([0.0, corner * np.pi / 2, 0.0]), np.zeros(3))
        place = sum(
            (
                side
                * Pose.from_rotvec(np.array([0.0, k * np.pi / 2, 0.0]), np.zeros(3)).apply(np.array([0.0, 0.0, 1.0]))
                for k in range(int(corner))
            ),
            np.zeros(3),
        )
        place = place + turn.apply(np.array([0.0, np.sin(i / 7.0), side * along]))
        found.append(Similarity(1.0, Pose(turn.rotation, place)))
    return tuple(found)


def noisy(measured: Similarity, rng: np.random.Generator, covariance: Array, scaled: bool) -> Similarity:
    d = rng.multivariate_normal(np.zeros(FREEDOM), covariance)
    return measured @ Similarity(float(np.exp(d[6])) if scaled else 1.0, Pose.from_rotvec(d[3:6], d[:3]))


def chain(
    truth: tuple[Similarity, ...], covariance: Array, rng: np.random.Generator, scaled: bool
) -> tuple[tuple[Similarity, ...], tuple[Edge, ...]]:
    """What odometry makes of it, and the edges that it measured."""
    nodes, edges = [truth[0]], []
    for i in range(1, len(truth)):
        step = noisy(truth[i - 1].inverse() @ truth[i], rng, covariance, scaled)
        edges.append(Edge(i - 1, i, step, covariance))
        nodes.append(nodes[-1] @ step)
    return tuple(nodes), tuple(edges)


def error(found: Similarity, true: Similarity) -> float:
    return float(np.linalg.norm(found.pose.translation - true.pose.translation))


@pytest.mark.parametrize("scaled", [False, True])
def test_exact_edges_give_the_truth_from_a_poor_start(scaled: bool) -> None:
    rng, truth = np.random.default_rng(0), block()
    edges = tuple(Edge(i - 1, i, truth[i - 1].inverse() @ truth[i], TIGHT) for i in range(1, COUNT))
    loop = Edge(0, COUNT - 1, truth[0].inverse() @ truth[-1], TIGHT)
    drift = np.diag([1e-2] * 3 + [1e-4] * 3 + [1e-4])
    start, _ = chain(truth, drift, rng, scaled)
    assert error(start[-1], truth[-1]) > 1.0
    found = optimise(start, (*edges, loop), scaled)
    for got, true in zip(found.nodes, truth, strict=True):
        np.testing.assert_allclose(got.pose.matrix, true.pose.matrix, atol=1e-7)
        assert got.scale == pytest.approx(true.scale, abs=1e-8)
    assert found.cost < 1e-8


@pytest.mark.parametrize("scaled", [False, True])
def test_a_loop_takes_the_drift_away_and_spreads_it(scaled: bool) -> None:
    """Of 300 m, 20 times: 0.1 % at the return with the loop; the middle of the route gains as well."""
    drift, truth = np.diag([4e-4] * 3 + [4e-6] * 3 + [4e-6 * scaled + 1e-12]), block()
    before, after = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        nodes, edges = chain(truth, drift, rng, scaled)
        exact = truth[1].inverse() @ truth[-1]
        loop = Edge(1, COUNT - 1, noisy(exact, rng, TIGHT, scaled), TIGHT)
        found = optimise(nodes, (*edges, loop), scaled)
        before.append([error(nodes[i], truth[i]) for i in (COUNT // 2, -1)])
        after.append([error(found.nodes[i], truth[i]) for i in (COUNT // 2, -1)])
    (middle_before, end_before), (middle, end) = np.median(before, axis=0), np.median(after, axis=0)
    assert end_before > 0.005 * 300 and end < 0.001 * 300
    assert middle < 0.8 * middle_before


@pytest.mark.parametrize("scaled", [False, True])
def test_one_false_loop_bends_nothing(scaled: bool) -> None:
    """Beside four right ones: the route is as it would be without it."""
    drift, truth = np.diag([4e-4] * 3 + [4e-6] * 3 + [4e-6 * scaled + 1e-12]), block()
    for seed in range(3):
        rng = np.random.default_rng(seed)
        nodes, edges = chain(truth, drift, rng, scaled)
        ends = [(0, COUNT - 1), (1, COUNT - 2), (2, COUNT - 3), (20, 60)]
        right = [(i, j, noisy(truth[i].inverse() @ truth[j], rng, TIGHT, scaled)) for i, j in ends]
        house = Similarity(1.0, Pose.from_rotvec(np.array([0.0, 0.1, 0.0]), np.array([12.0, 0.0, 3.0])))
        false = 10, 45, truth[10].inverse() @ truth[45] @ house
        loops = [Edge(i, j, way, TIGHT, True) for i, j, way in (*right, false)]
        wanted = optimise(nodes, (*edges, *loops[:-1]), scaled)
        found = optimise(nodes, (*edges, *loops), scaled)
        assert (found.weights[:-1] == 1).all() and found.weights[-1] == 0
        apart = [error(a, b) for a, b in zip(found.nodes, wanted.nodes, strict=True)]
        assert max(apart) < 1e-3
        held = (*edges, *(replace(loop, may_be_false=False) for loop in loops))
        assert error(optimise(nodes, held, scaled).nodes[45], truth[45]) > 1.0, "by all of them alike it would be bent"


def test_a_single_loop_counts_however_far_odometry_drifted() -> None:
    """Nothing contradicts it but odometry, which drifts by more than it claims."""
    truth, drift = block(), np.diag([1e-2] * 3 + [1e-4] * 3 + [1e-12])
    nodes, edges = chain(truth, drift, np.random.default_rng(0), False)
    sure = tuple(replace(edge, covariance=1e-2 * drift) for edge in edges)
    loop = Edge(0, COUNT - 1, truth[0].inverse() @ truth[-1], TIGHT, True)
    found = optimise(nodes, (*sure, loop), False)
    assert found.weights[-1] == 1 and error(found.nodes[-1], truth[-1]) < 0.1 < 1.0 < error(nodes[-1], truth[-1])


def test_the_covariance_is_that_of_the_errors() -> None:
    """Normalised squared errors of the last pose over 200 noisy loops: 6 on average, with 4 sigma of that."""
    drift, truth = np.diag([4e-4] * 3 + [1e-6] * 3 + [1e-12]), block(40, 20.0)
    found = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        nodes, edges = chain(truth, drift, rng, False)
        loop = Edge(0, 39, noisy(truth[0].inverse() @ truth[-1], rng, TIGHT, False), TIGHT)
        got = optimise(nodes, (*edges, loop), False)
        assert not got.covariance[6].any() and not got.covariance[:, 6].any(), "of a pair the unit is known"
        off = truth[-1].inverse() @ got.nodes[-1]
        d = np.concatenate([off.pose.translation, off.pose.rotvec])
        found.append(float(d @ np.linalg.solve(got.covariance[:6, :6], d)))
    assert np.mean(found) == pytest.approx(6.0, abs=4 * np.sqrt(12 / 200))


def test_edges_that_follow_each_other_are_one() -> None:
    rng, truth = np.random.default_rng(2), block(5)
    a, b = (Edge(i, i + 1, truth[i].inverse() @ truth[i + 1], TIGHT * (i + 1)) for i in range(2))
    both = joined(a, b)
    assert (both.first, both.then) == (0, 2)
    np.testing.assert_allclose(both.first_from_then.pose.matrix, (truth[0].inverse() @ truth[2]).pose.matrix)
    some = [
        noisy(a.first_from_then, rng, a.covariance, True) @ noisy(b.first_from_then, rng, b.covariance, True)
        for _ in range(4000)
    ]
    offs = [both.first_from_then.inverse() @ s for s in some]
    d = np.array([[*o.pose.translation, *o.pose.rotvec, np.log(o.scale)] for o in offs])
    np.testing.assert_allclose(np.cov(d.T), both.covariance, atol=0.1 * np.abs(both.covariance).max())
    again = reversed_edge(reversed_edge(both))
    np.testing.assert_allclose(again.covariance, both.covariance, atol=1e-12)


def test_a_perturbation_is_carried_along() -> None:
    between = Similarity(1.7, Pose.from_rotvec(np.array([0.3, -0.8, 0.4]), np.array([1.0, 2.0, -3.0])))
    d = 1e-6 * np.array([1.0, -2.0, 0.5, 0.3, 0.7, -0.2, 0.9])
    early = Similarity(float(np.exp(d[6])), Pose.from_rotvec(d[3:6], d[:3])) @ between
    e = adjoint_sim3(between) @ d
    late = between @ Similarity(float(np.exp(e[6])), Pose.from_rotvec(e[3:6], e[:3]))
    np.testing.assert_allclose(early.pose.matrix, late.pose.matrix, atol=1e-10)
    assert early.scale == pytest.approx(late.scale, abs=1e-11)
    assert rotation_angle_rad(early.pose.rotation) > 0.5
