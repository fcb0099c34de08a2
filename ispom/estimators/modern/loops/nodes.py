"""Nodes of the pose graph: keyframes at some distance from each other, of bounded number."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ispom.estimators.modern.keyframe_database import most_crowded
from ispom.estimators.modern.loops.relative_pose import DescribedPoints
from ispom.geometry import Array, Pose, Similarity
from ispom.solvers.pose_graph import FREEDOM, Edge, joined, reversed_edge

MAX_NODES = 256
"""Largest number of nodes: some 30 MB of described points, and 30 ms per optimisation."""
RECENT = 16
"""Number of the newest nodes, which are never thinned out."""
APART_DEPTHS, APART_DEG = 0.25, 12.0
"""Distance from the last node, in scene depths, or rotation [deg], from which a keyframe becomes a node: a third of the
change across which descriptors match."""
NO_GUESS = 1e6
"""Factor on the variance of a guessed step that a loop has contradicted: the step then has no influence."""
LEAST_SHARE, LEAST_RAD, LEAST_SCALE = 1e-3, 1e-4, 1e-3
"""Least standard deviations of the step between two nodes: translation as a share of its length, rotation [rad], ln
scale."""


@dataclass(frozen=True, eq=False)
class Node:
    time_ns: int
    parent_ns: int
    """Time of the node that its pose was estimated from; its own for the first node."""
    odometry: Pose
    """world_from_camera without loops."""
    covariance: Array
    """(6, 6) covariance of the right twist of `odometry`."""
    scale_variance: float
    """Variance of ln scale; 0 for a pair."""
    path: float
    """Length of the path up to this node."""
    corrected: Similarity
    """world_from_node with loops."""
    described: DescribedPoints
    connected: bool = True
    """Whether an observation connects it to its parent; otherwise the step is a guess across a gap."""
    segment: int = 0
    """The segment of its pose; the earlier one once a loop has joined two segments."""
    guessed: bool = True
    """Whether a guessed step from its parent is still valid; False once a loop has contradicted it."""
    step: Pose | None = None
    """parent_from_node when both were last optimised together; None: computed from their odometry. It does not change
    after the parent has left the window, while all poses in the window still move together as scale and heading
    converge."""

    @property
    def correction(self) -> Similarity:
        """corrected_world_from_world."""
        return self.corrected @ Similarity(1.0, self.odometry.inverse())


@dataclass(frozen=True, eq=False)
class Loop:
    """A measured relative pose of two nodes, which are identified by their times."""

    first_ns: int
    then_ns: int
    first_from_then: Similarity
    covariance: Array


def step_between(parent: Node, node: Node) -> tuple[Similarity, Array]:
    """Returns parent_from_node by odometry and its covariance (7, 7): the growth of the covariance between the nodes.

    Also works for nodes that are far apart.
    """
    own = node.step is not None and node.parent_ns == parent.time_ns
    between = node.step if own and node.step is not None else parent.odometry.inverse() @ node.odometry
    scale_variance = max(node.scale_variance - parent.scale_variance, 0.0)
    return Similarity(1.0, between), growth(between, parent.covariance, node.covariance, scale_variance)


def growth(between: Pose, before: Array, after: Array, scale_variance: float) -> Array:
    """Returns the growth (7, 7) of the covariance of the odometry over the step `between`: right perturbations, from
    the covariances (6, 6) of the poses before and after it and the growth of the variance of ln scale."""
    back = between.inverse().adjoint
    grown = after - back @ before @ back.T
    values, vectors = np.linalg.eigh((grown + grown.T) / 2)
    length = float(np.linalg.norm(between.translation))
    least = np.repeat([LEAST_SHARE * length + 1e-9, LEAST_RAD], 3)
    covariance = np.zeros((FREEDOM, FREEDOM))
    covariance[:6, :6] = (vectors * np.maximum(values, 0.0)) @ vectors.T + np.diag(least**2)
    covariance[6, 6] = scale_variance + LEAST_SCALE**2
    return covariance


def with_poses(nodes: tuple[Node, ...], odometry: Mapping[int, Pose], since_ns: int | None) -> tuple[Node, ...]:
    """Updates the poses of some nodes, and the steps between those.

    After an optimisation of the graph up to `since_ns`, corrected poses up to there are kept, and later ones follow by
    their steps. Without one (None), all corrected poses follow the odometry.
    """
    at = dict[int, Node]()
    for node in nodes:
        updated, parent = node, at.get(node.parent_ns)
        if (pose := odometry.get(node.time_ns)) is not None:
            step = node.step
            if parent is not None and node.connected and parent.time_ns in odometry:
                step = parent.odometry.inverse() @ pose
            corrected = node.corrected if since_ns is not None else node.correction @ Similarity(1.0, pose)
            updated = replace(node, odometry=pose, step=step, corrected=corrected)
        if since_ns is not None and node.time_ns > since_ns and parent is not None:
            updated = replace(updated, corrected=parent.corrected @ step_between(parent, updated)[0])
        at[node.time_ns] = updated
    return tuple(at.values())


def thinned(nodes: tuple[Node, ...], loops: tuple[Loop, ...]) -> tuple[tuple[Node, ...], tuple[Loop, ...]]:
    """Removes, if there are too many nodes, the older one whose neighbours are nearest to each other along the path.

    Its children are attached to its parent, and loops that end at it are composed with the step to the parent.
    """
    if len(nodes) <= MAX_NODES:
        return nodes, loops
    gone = nodes[most_crowded([n.path for n in nodes[: MAX_NODES - RECENT]])]
    parent = node_at(nodes, gone.parent_ns)
    between, covariance = step_between(parent, gone)
    down = Edge(0, 1, between, covariance)
    kept = tuple(
        replace(
            n,
            parent_ns=parent.time_ns,
            connected=n.connected and gone.connected,
            step=between.pose @ step_between(gone, n)[0].pose,
        )
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
            # Only the newest of several loops that end at one node is kept, so that their number is bounded.
            moved[then_ns] = Loop(first_ns, then_ns, edge.first_from_then, edge.covariance)
    return kept, tuple(moved.values())


def node_at(nodes: tuple[Node, ...], time_ns: int) -> Node:
    """Returns the node at this time or the last one before it; the first node if there is none before."""
    before = [n for n in nodes if n.time_ns <= time_ns]
    return before[-1] if before else nodes[0]


def joined_segments(nodes: tuple[Node, ...], loop: Loop, contradicted: bool) -> tuple[Node, ...]:
    """Joins the segments at both ends of a loop. If the loop has `contradicted` the guessed step, the later segment is
    moved, rotated and scaled to fit the loop."""
    first, then = node_at(nodes, loop.first_ns), node_at(nodes, loop.then_ns)
    moved = first.corrected @ loop.first_from_then @ then.corrected.inverse() if contradicted else Similarity()
    return tuple(
        replace(n, corrected=moved @ n.corrected, segment=first.segment, guessed=n.connected or not contradicted)
        if n.segment == then.segment
        else n
        for n in nodes
    )


def _weighted_step(parent: Node, node: Node) -> tuple[Similarity, Array]:
    step, covariance = step_between(parent, node)
    if node.guessed:
        return step, covariance
    return step, NO_GUESS * (covariance + np.diag([float(np.sum(step.pose.translation**2))] * 3 + [1.0] * 4))


def edges_of(nodes: tuple[Node, ...], loops: tuple[Loop, ...]) -> tuple[Edge, ...]:
    """Returns the edges of the odometry and of the loops."""
    index = {n.time_ns: i for i, n in enumerate(nodes)}
    parents = [index[n.parent_ns] for n in nodes]
    steps = (Edge(p, i, *_weighted_step(nodes[p], nodes[i])) for i, p in enumerate(parents) if i)
    found = (Edge(index[x.first_ns], index[x.then_ns], x.first_from_then, x.covariance, True) for x in loops)
    return (*steps, *found)
