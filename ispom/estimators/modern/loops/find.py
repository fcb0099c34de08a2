"""Which earlier places may be seen again from a node, and whether several views tell of the same loop."""

from __future__ import annotations

import numpy as np
from scipy.special import chdtri

from ispom.estimators.modern.loops.nodes import Loop, Node, step_between
from ispom.geometry import Similarity, rotation_angle_rad
from ispom.solvers.pose_graph import FREEDOM, Edge, joined, reversed_edge

PAIR_DRIFT, SINGLE_DRIFT = 0.02, 0.06
"""Error of odometry, as a share of the way, that is always possible: three times that of a pair and of one camera on
real drives. Beyond, and beyond what odometry itself holds possible, it is no loop, but houses that look alike."""
DEVIATIONS = 5.0
"""Of what odometry says of itself that are held possible."""
MAX_TURN_DEG, MAX_SCALE = 20.0, 0.4
"""The same of orientation, and of ln unit (where it drifts): 1.5 times."""
LEAST_NODES = 12
"""From so many nodes on, three depths of what they show or 144 degrees, a place is seen again by a loop, and not
because it is still near."""
COMPARED = 12
"""Places, for each node: those that look most like it. Of views that are turned by 20-40 degrees the right place may be
the sixth."""
VIEWS = 3
"""Nodes whose views tell of the same loop: chance seldom leads three of them to one place."""
WITHIN = 12
"""Of the last so many nodes."""
MAJORITY = 2 / 3
"""Of the views that tell of a loop: where more tell of others, houses look alike."""
AGREEING_DEPTHS, AGREEING_DEG = 0.1, 2.0
"""By how much what they tell of the last pose may differ, beside what odometry drifts between them; of the unit, which
some views know to 1 % and others to 10 %, by what they claim."""

MOST_UNLIKELY = float(chdtri(FREEDOM, 0.05))
"""The squared deviations of that difference, by what both views and the odometry between them claim: 95 % of seven
degrees of freedom. Of 600 pairs of true views none had more than 9.6; of four that were 0.4-0.9 m off, by 26 to 64
points, up to 41."""


def candidates(nodes: tuple[Node, ...], node: Node, drift: float) -> tuple[int, ...]:
    """Times of the places that a node after these may see again, those that look most like it first."""
    found = list[tuple[float, int]]()
    for place in nodes[: -LEAST_NODES + 1]:
        apart = np.linalg.norm((place.corrected.inverse() @ node.corrected).pose.translation)
        if place.segment != node.segment or apart <= place.sight.depth + _slack(place, node, drift):
            found.append((-float((place.sight.looks * node.sight.looks).sum()), place.time_ns))
    return tuple(time_ns for _, time_ns in sorted(found)[:COMPARED])


def possible(first: Node, then: Node, first_from_then: Similarity, drift: float) -> bool:
    """Whether a loop between two nodes can be true: nothing is known of the place and unit of another segment."""
    return first.segment != then.segment or within_drift(first, then, first_from_then, drift)


def within_drift(first: Node, then: Node, first_from_then: Similarity, drift: float) -> bool:
    """Whether odometry can have drifted by what a way between two nodes says.

    Where the unit has, by ln scale, by half of that what lies between was too long or too short: a unit that was lost
    in a bend moves what comes after it by as much of the way, and says so itself.
    """
    off = (first.corrected.inverse() @ then.corrected).inverse() @ first_from_then
    by_unit = abs(float(np.log(off.scale))) / 2 * (then.path - first.path)
    return (
        float(np.linalg.norm(off.pose.translation)) <= max(_slack(first, then, drift), by_unit)
        and float(np.degrees(rotation_angle_rad(off.pose.rotation))) <= MAX_TURN_DEG
        and abs(float(np.log(off.scale))) <= MAX_SCALE
    )


def _slack(first: Node, then: Node, drift: float) -> float:
    """How far odometry may be off; where a blind start lies between them, by what that may have missed."""
    _, covariance = step_between(first, then)
    return max(drift * (then.path - first.path), DEVIATIONS * float(np.sqrt(np.trace(covariance[:3, :3]))))


def agreeing(nodes: tuple[Node, ...], proposed: tuple[Loop, ...], loop: Loop, drift: float) -> tuple[Loop, ...]:
    """Those of the proposed loops that tell the same of the newest node as this one, itself included, and as the
    majority of these: one that is vague contradicts none of several that contradict each other, and by it a way that
    was 3 m off, of 29 points, came into the graph beside four right ones."""
    at, newest = {n.time_ns: n for n in nodes}, nodes[-1]
    same = [one for one in proposed if _same(at, newest, one, loop, drift)]
    least = MAJORITY * len(same)
    return tuple(one for one in same if sum(_same(at, newest, other, one, drift) for other in same) >= least)


def _same(at: dict[int, Node], newest: Node, one: Loop, loop: Loop, drift: float) -> bool:
    """Whether one loop tells the same of the newest node as another."""

    def told(one: Loop) -> Similarity:
        first, then = at[one.first_ns], at[one.then_ns]
        return first.corrected @ one.first_from_then @ then.corrected.inverse() @ newest.corrected

    off = told(one).inverse() @ told(loop)
    near = AGREEING_DEPTHS * at[one.first_ns].sight.depth
    near += drift * abs(at[loop.then_ns].path - at[one.then_ns].path)
    turned = float(np.degrees(rotation_angle_rad(off.pose.rotation)))
    return bool(
        np.linalg.norm(off.pose.translation) <= near
        and turned <= AGREEING_DEG
        and _unlikely(at, one, loop) <= MOST_UNLIKELY
    )


def _unlikely(at: dict[int, Node], one: Loop, loop: Loop) -> float:
    """Squared deviations of what one loop tells from what the other does; 0 of itself."""
    if one is loop:
        return 0.0
    here, there = _odometry(at[loop.first_ns], at[one.first_ns]), _odometry(at[one.then_ns], at[loop.then_ns])
    told = joined(joined(here, Edge(0, 0, one.first_from_then, one.covariance)), there)
    off = told.first_from_then.inverse() @ loop.first_from_then
    error = np.concatenate([off.pose.translation, off.pose.rotvec, [np.log(off.scale)]])
    return float(error @ np.linalg.solve(told.covariance + loop.covariance, error))


def _odometry(a: Node, b: Node) -> Edge:
    """a_from_b."""
    if a is b:
        return Edge(0, 0, Similarity(), np.zeros((FREEDOM, FREEDOM)))
    return Edge(0, 0, *step_between(a, b)) if a.time_ns < b.time_ns else reversed_edge(_odometry(b, a))
