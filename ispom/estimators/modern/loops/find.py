"""Finds candidates for loops, and checks that several views agree on one loop."""

from __future__ import annotations

import numpy as np
from scipy.special import chdtri

from ispom.estimators.modern import trials
from ispom.estimators.modern.loops.nodes import Loop, Node, step_between
from ispom.estimators.modern.trials import judged
from ispom.geometry import Similarity, rotation_angle_rad
from ispom.solvers.pose_graph import FREEDOM, Edge, joined, reversed_edge

PAIR_DRIFT, SINGLE_DRIFT = 0.02, 0.06
"""Drift of the odometry, relative to the path, that is always possible: three times that of a stereo pair and of one
camera on real drives. Loops beyond it, and beyond the odometry's covariance, join similar houses."""
DEVIATIONS = 5.0
"""Largest drift, in standard deviations of the odometry."""
MAX_TURN_DEG, MAX_SCALE = 20.0, 0.4
"""Largest drift of orientation [deg], and of ln scale for one camera: a factor of 1.5."""
LEAST_NODES = 12
"""Number of nodes (three scene depths, or 144 degrees) after which a match is a loop; before, the scene may still be
visible."""
COMPARED = 12
"""Number of candidates compared per node, by similarity of appearance. After rotations of 20-40 degrees the right one
may be the sixth."""
VIEWS = 3
"""Number of nodes that must agree on a loop: three rarely agree by chance."""
WITHIN = 12
"""Number of the last nodes whose loops are compared."""
MAJORITY = 2 / 3
"""Share of the proposed loops that must agree: if more contradict them, houses look alike."""
AGREEING_DEPTHS, AGREEING_DEG = 0.1, 2.0
"""Largest difference of the poses that two loops give the newest node, in scene depths and degrees, besides drift.
Scale, which some views know to 1 % and others to 10 %, is compared by covariance."""

MOST_UNLIKELY = float(chdtri(FREEDOM, 0.05))
"""Largest squared Mahalanobis distance of two loops, by their covariances and that of the odometry between them: 95 %
of chi-squared with seven degrees of freedom. Of 600 pairs of true loops none had more than 9.6; four loops with errors
of 0.4-0.9 m, of 26 to 64 points, had up to 41."""


def candidates(nodes: tuple[Node, ...], node: Node, drift: float) -> tuple[int, ...]:
    """Returns the times of the earlier nodes that a new node may observe again, those with the most similar appearance
    first."""
    found = list[tuple[float, int]]()
    for candidate in nodes[: -LEAST_NODES + 1]:
        apart, limit = reach(candidate, node, drift)
        if apart <= limit:
            found.append((-similarity(candidate, node), candidate.time_ns))
    return tuple(time_ns for _, time_ns in sorted(found)[:COMPARED])


def reach(candidate: Node, node: Node, drift: float) -> tuple[float, float]:
    """Returns the distance of two nodes, and the largest one at which the newer may observe what the other did: without
    limit for nodes of two segments."""
    apart = float(np.linalg.norm((candidate.corrected.inverse() @ node.corrected).pose.translation))
    if candidate.segment != node.segment:
        return apart, float("inf")
    return apart, candidate.described.depth + _slack(candidate, node, drift)


def similarity(candidate: Node, node: Node) -> float:
    """Returns how similar two nodes look, 1 for the same image."""
    return float((candidate.described.looks * node.described.looks).sum())


def possible(first: Node, then: Node, first_from_then: Similarity, drift: float) -> bool:
    """Checks that a loop between two nodes is possible: nothing constrains the relative pose and scale of two
    segments."""
    return first.segment != then.segment or within_drift(first, then, first_from_then, drift)


def within_drift(first: Node, then: Node, first_from_then: Similarity, drift: float) -> bool:
    """Checks that a loop requires no more drift than the odometry can have.

    A scale drift by ln s allows a translation of half of ln s times the path between the nodes: a scale that was lost
    in a bend displaces everything after it, and shows in the scale of the loop itself.
    """
    off = (first.corrected.inverse() @ then.corrected).inverse() @ first_from_then
    by_unit = abs(float(np.log(off.scale))) / 2 * (then.path - first.path)
    away, possible_away = float(np.linalg.norm(off.pose.translation)), max(_slack(first, then, drift), by_unit)
    turned, scaled = float(np.degrees(rotation_angle_rad(off.pose.rotation))), abs(float(np.log(off.scale)))
    near = judged(away <= possible_away, trials.DRIFT, away, possible_away)
    near &= judged(turned <= MAX_TURN_DEG, trials.DRIFT_TURN, turned, MAX_TURN_DEG)
    return near & judged(scaled <= MAX_SCALE, trials.DRIFT_SCALE, scaled, MAX_SCALE)


def _slack(first: Node, then: Node, drift: float) -> float:
    """Returns the largest possible drift of the translation; across a segment without tracking its covariance
    dominates."""
    _, covariance = step_between(first, then)
    return max(drift * (then.path - first.path), DEVIATIONS * float(np.sqrt(np.trace(covariance[:3, :3]))))


def agreeing(nodes: tuple[Node, ...], proposed: tuple[Loop, ...], loop: Loop, drift: float) -> tuple[Loop, ...]:
    """Returns the proposed loops, `loop` included, that agree with it about the pose of the newest node and with
    MAJORITY of each other. A vague loop agrees with several that contradict each other: through one, a loop with an
    error of 3 m and 29 points entered the graph together with four right ones."""
    at, newest = {n.time_ns: n for n in nodes}, nodes[-1]
    same = [one for one in proposed if _agree(at, newest, one, loop, drift)]
    least = MAJORITY * len(same)
    return tuple(one for one in same if sum(_agree(at, newest, other, one, drift) for other in same) >= least)


def _agree(at: dict[int, Node], newest: Node, one: Loop, loop: Loop, drift: float) -> bool:
    """Checks that two loops agree about the pose of the newest node."""

    def newest_by(one: Loop) -> Similarity:
        first, then = at[one.first_ns], at[one.then_ns]
        return first.corrected @ one.first_from_then @ then.corrected.inverse() @ newest.corrected

    off = newest_by(one).inverse() @ newest_by(loop)
    near = AGREEING_DEPTHS * at[one.first_ns].described.depth
    near += drift * abs(at[loop.then_ns].path - at[one.then_ns].path)
    turned = float(np.degrees(rotation_angle_rad(off.pose.rotation)))
    return bool(
        np.linalg.norm(off.pose.translation) <= near
        and turned <= AGREEING_DEG
        and _squared_distance(at, one, loop) <= MOST_UNLIKELY
    )


def _squared_distance(at: dict[int, Node], one: Loop, loop: Loop) -> float:
    """Returns the squared Mahalanobis distance between two loops; 0 for the same loop."""
    if one is loop:
        return 0.0
    here, there = _odometry(at[loop.first_ns], at[one.first_ns]), _odometry(at[one.then_ns], at[loop.then_ns])
    expected = joined(joined(here, Edge(0, 0, one.first_from_then, one.covariance)), there)
    off = expected.first_from_then.inverse() @ loop.first_from_then
    error = np.concatenate([off.pose.translation, off.pose.rotvec, [np.log(off.scale)]])
    return float(error @ np.linalg.solve(expected.covariance + loop.covariance, error))


def _odometry(a: Node, b: Node) -> Edge:
    """Returns the edge a_from_b of the odometry."""
    if a is b:
        return Edge(0, 0, Similarity(), np.zeros((FREEDOM, FREEDOM)))
    return Edge(0, 0, *step_between(a, b)) if a.time_ns < b.time_ns else reversed_edge(_odometry(b, a))
