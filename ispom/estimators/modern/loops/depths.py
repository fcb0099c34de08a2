"""Depths of one camera's features: matched along epipolar lines between nodes, and triangulated with their odometry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.estimators.modern.loops.nodes import Node, node_at, step_between
from ispom.estimators.modern.loops.relative_pose import DescribedPoints, LoopCamera
from ispom.estimators.modern.verification import on_epipolar_lines
from ispom.geometry import Array
from ispom.numerics.robust import Noise
from ispom.solvers.multiview.inverse_depth import intersect

OTHERS = 3
"""Number of nodes before and after a node with which its features are triangulated: at most three quarters of the scene
depth away."""
AROUND = 2
"""Number of nodes before and after a candidate whose points are compared together. In one node of one camera a third of
the features has a depth, and a tenth of these is matched after a rotation of 25 degrees: 8 points, 17 together."""
MAX_OFF, INLIER = 2.0, 4.0
"""Inlier limits of the distance from an epipolar line and of the reprojection error, in standard deviations of a
feature."""
MIN_SIGNIFICANCE = 3.0
"""Least inverse depth of a point, in its standard deviations: far points still constrain rotation."""


def with_depths(camera: LoopCamera, nodes: tuple[Node, ...]) -> tuple[Node, ...]:
    """Triangulates the features of the newest node, and those of an earlier node that it completes.

    The node OTHERS before it is triangulated again with all nodes since, which adds another half of its depths. So is
    the parent, if no node is before it. Nothing is triangulated across a gap in tracking, whose length only loops
    measure.
    """
    newest, before = nodes[-1], _before(nodes)
    if not before:
        return nodes
    found = {newest.time_ns: _triangulated(camera, newest, before)}
    if len(before) == OTHERS:
        found[before[-1].time_ns] = _triangulated(camera, before[-1], [newest, *before[:-1]])
    elif not np.isfinite(before[0].described.xyz).any():
        found[before[0].time_ns] = _triangulated(camera, before[0], [newest])
    return tuple(replace(n, described=found[n.time_ns]) if n.time_ns in found else n for n in nodes)


def _before(nodes: tuple[Node, ...]) -> list[Node]:
    """Returns up to OTHERS nodes before the newest one, nearest first, with odometry chained from the steps between
    them."""
    last, found = nodes[-1], list[Node]()
    while len(found) < OTHERS and last.connected and last.parent_ns != last.time_ns:
        parent = node_at(nodes, last.parent_ns)
        last = replace(parent, odometry=last.odometry @ step_between(parent, last)[0].pose.inverse())
        found.append(last)
    return found


def surroundings(nodes: tuple[Node, ...], candidate: Node) -> DescribedPoints:
    """Returns the points with depth of a node and of up to AROUND nodes before and after it, in the node's camera."""
    at = next(i for i, n in enumerate(nodes) if n.time_ns == candidate.time_ns)
    others, last = _before(nodes[: at + 1])[:AROUND], candidate
    for node in nodes[at + 1 : at + 1 + AROUND]:
        if not node.connected or node.parent_ns != last.time_ns:
            break
        last = replace(node, odometry=last.odometry @ step_between(last, node)[0].pose)
        others.append(last)
    shown = [n.described.with_depth() for n in (candidate, *others)]
    xyz = [
        (candidate.odometry.inverse() @ n.odometry).apply(s.xyz.astype(float))
        for n, s in zip((candidate, *others), shown, strict=True)
    ]
    return replace(
        candidate.described,
        x=np.concatenate([s.x for s in shown]),
        descriptors=np.concatenate([s.descriptors for s in shown]),
        xyz=np.concatenate(xyz).astype(np.float32),
    )


def _triangulated(camera: LoopCamera, node: Node, others: list[Node]) -> DescribedPoints:
    """Triangulates a node's features with other nodes; features without a good result keep their points."""
    described = node.described
    stacked = np.stack([described.x.astype(float), *(_matched(camera, node, other) for other in others)])
    owners, cameras = np.nonzero(np.isfinite(stacked[:, :, 0]).T)
    poses = [n.odometry.inverse() for n in (node, *others)]
    rotations, translations = np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses])
    found = intersect(
        rotations, translations, cameras, owners, stacked[cameras, owners], len(described.x), Noise(camera.sigma)
    )
    good = (found.depth > 0) & (found.worst < INLIER * camera.sigma) & (found.significance > MIN_SIGNIFICANCE)
    xyz = np.where(good[:, None], poses[0].apply(found.xyz_in_world), described.xyz)
    return replace(described, xyz=xyz.astype(np.float32))


def _matched(camera: LoopCamera, node: Node, other: Node) -> Array:
    """Returns the normalised coordinates (N, 2), in another node, of a node's features: their best matches on the
    epipolar lines, or NaN."""
    here, there = node.described.features(camera.fx), other.described.features(camera.fx)
    motion = other.odometry.inverse() @ node.odometry
    allowed = on_epipolar_lines(motion, node.described.x, other.described.x, MAX_OFF * camera.sigma)
    pairs, _ = camera.matcher.match_where(here, there, allowed)
    out = np.full((len(here), 2), np.nan)
    out[pairs[:, 0]] = other.described.x[pairs[:, 1]]
    return out
