"""The places on a route that a pose graph joins: key frames some way apart, at most so many, older ones thinned out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ispom.estimators.modern.keyframe_database import most_crowded
from ispom.estimators.modern.loops.relative_pose import DescribedPoints
from ispom.geometry import Array, Pose, Similarity
from ispom.solvers.pose_graph import FREEDOM, Edge, joined, reversed_edge

MAX_NODES = 256
"""With their sights some 30 MB, and 30 ms for the graph."""
RECENT = 16
"""So many of the newest are never thinned out."""
APART_DEPTHS, APART_DEG = 0.25, 12.0
"""A key frame so far from the last node, in depths of what it sees, or turned by so much, is the next one: a third of
what descriptors bridge."""
NO_GUESS = 1e6
"""Times the variance of a way that was guessed, once that is known to be wrong: it holds nothing."""
LEAST_SHARE, LEAST_RAD, LEAST_SCALE = 1e-3, 1e-4, 1e-3
"""What the way between two nodes is never surer than: share of its length, [rad], ln of the unit."""


@dataclass(frozen=True, eq=False)
class Node:
    time_ns: int
    parent_ns: int
    """Of the node that its pose was found from; its own, for the first."""
    odometry: Pose
    """world_from_camera without any loop."""
    covariance: Array
    """(6, 6) of its right twist."""
    scale_variance: float
    """Of ln unit; 0 for a pair."""
    path: float
    """Length of the way up to here."""
    corrected: Similarity
    """world_from_node, with the loops."""
    sight: DescribedPoints
    seen: bool = True
    """Whether some observation joins it to its parent: else the way there is what a blind start holds possible."""
    segment: int = 0
    """That of its pose; an earlier one once a loop has joined both."""
    guessed: bool = True
    """Whether the way from its parent is at least a guess, where nothing was seen: not if a loop contradicts it."""
    step: Pose | None = None
    """parent_from_node when both were last adjusted together; None: from their odometry. That of a parent that has left
    its window stays, while all that is in the window still moves, alike, as the unit and the heading become known."""

    @property
    def correction(self) -> Similarity:
        """corrected_world_from_world."""
        return self.corrected @ Similarity(1.0, self.odometry.inverse())


@dataclass(frozen=True, eq=False)
class Loop:
    """A way that was measured between two nodes, told by their times."""

    first_ns: int
    then_ns: int
    first_from_then: Similarity
    covariance: Array


def step_between(parent: Node, node: Node) -> tuple[Similarity, Array]:
    """parent_from_node by odometry, and its covariance (7, 7): by how much more is unknown at the node.

    Of two nodes far apart, too.
    """
    own = node.step is not None and node.parent_ns == parent.time_ns
    between = node.step if own and node.step is not None else parent.odometry.inverse() @ node.odometry
    back = between.inverse().adjoint
    grown = node.covariance - back @ parent.covariance @ back.T
    values, vectors = np.linalg.eigh((grown + grown.T) / 2)
    length = float(np.linalg.norm(between.translation))
    least = np.repeat([LEAST_SHARE * length + 1e-9, LEAST_RAD], 3)
    covariance = np.zeros((FREEDOM, FREEDOM))
    covariance[:6, :6] = (vectors * np.maximum(values, 0.0)) @ vectors.T + np.diag(least**2)
    covariance[6, 6] = max(node.scale_variance - parent.scale_variance, 0.0) + LEAST_SCALE**2
    return Similarity(1.0, between), covariance


def with_poses(nodes: tuple[Node, ...], odometry: Mapping[int, Pose], since_ns: int | None) -> tuple[Node, ...]:
    """With newer poses of some, and steps from those whose parents are among them.

    Where a graph was adjusted, up to a node `since_ns`, these nodes stay where it put them, and later ones follow from
    there. Where none was, None, all are where odometry has them.
    """
    at = dict[int, Node]()
    for node in nodes:
        told, parent = node, at.get(node.parent_ns)
        if (pose := odometry.get(node.time_ns)) is not None:
            step = node.step
            if parent is not None and node.seen and parent.time_ns in odometry:
                step = parent.odometry.inverse() @ pose
            corrected = node.corrected if since_ns is not None else node.correction @ Similarity(1.0, pose)
            told = replace(node, odometry=pose, step=step, corrected=corrected)
        if since_ns is not None and node.time_ns > since_ns and parent is not None:
            told = replace(told, corrected=parent.corrected @ step_between(parent, told)[0])
        at[node.time_ns] = told
    return tuple(at.values())


def thinned(nodes: tuple[Node, ...], loops: tuple[Loop, ...]) -> tuple[tuple[Node, ...], tuple[Loop, ...]]:
    """Where there are too many, without the older one that has its neighbours nearest along the way.

    What hangs on it hangs on its parent then, and loops that end at it are joined with the way to that.
    """
    if len(nodes) <= MAX_NODES:
        return nodes, loops
    gone = nodes[most_crowded([n.path for n in nodes[: MAX_NODES - RECENT]])]
    parent = node_at(nodes, gone.parent_ns)
    way, covariance = step_between(parent, gone)
    down = Edge(0, 1, way, covariance)
    kept = tuple(
        replace(n, parent_ns=parent.time_ns, seen=n.seen and gone.seen, step=way.pose @ step_between(gone, n)[0].pose)
        if n.parent_ns == gone.time_ns
        else n
        for n in nodes
        if n is not gone
    )
    moved = dict[int, Loop]()
    for loop in loops:
        first_ns, then_ns, edge = loop.first_ns, loop.then_ns, Edge(1, 2, loop.first_from_then, loop.covariance)
        if first_ns == gone.time_ns:
            first_ns, edge = parent.time_ns, joined(down, edge)
        elif then_ns == gone.time_ns:
            then_ns, edge = parent.time_ns, joined(edge, reversed_edge(down))
        if first_ns != then_ns:
            # Of several that end at one node the newest one: their number is bounded.
            moved[then_ns] = Loop(first_ns, then_ns, edge.first_from_then, edge.covariance)
    return kept, tuple(moved.values())


def node_at(nodes: tuple[Node, ...], time_ns: int) -> Node:
    """The one at this time, or the last before it; the first, where there is none before."""
    before = [n for n in nodes if n.time_ns <= time_ns]
    return before[-1] if before else nodes[0]


def joined_segments(nodes: tuple[Node, ...], loop: Loop, contradicted: bool) -> tuple[Node, ...]:
    """With the segment in which a loop ends as one with that in which it begins; where the loop has `contradicted` what
    was guessed of it, moved, turned and scaled to where the loop puts it."""
    first, then = node_at(nodes, loop.first_ns), node_at(nodes, loop.then_ns)
    moved = first.corrected @ loop.first_from_then @ then.corrected.inverse() if contradicted else Similarity()
    return tuple(
        replace(n, corrected=moved @ n.corrected, segment=first.segment, guessed=n.seen or not contradicted)
        if n.segment == then.segment
        else n
        for n in nodes
    )


def _way(parent: Node, node: Node) -> tuple[Similarity, Array]:
    step, covariance = step_between(parent, node)
    if node.guessed:
        return step, covariance
    return step, NO_GUESS * (covariance + np.diag([float(np.sum(step.pose.translation**2))] * 3 + [1.0] * 4))


def edges_of(nodes: tuple[Node, ...], loops: tuple[Loop, ...]) -> tuple[Edge, ...]:
    """Of odometry, and of the loops."""
    index = {n.time_ns: i for i, n in enumerate(nodes)}
    ways = (Edge(index[n.parent_ns], i, *_way(nodes[index[n.parent_ns]], n)) for i, n in enumerate(nodes) if i)
    found = (Edge(index[x.first_ns], index[x.then_ns], x.first_from_then, x.covariance, True) for x in loops)
    return (*ways, *found)
