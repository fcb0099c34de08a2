"""Depths of what one camera's sights show: met along epipolar lines between nodes, by the way that odometry says."""

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
"""Nodes before, and after, from which a sight is met: three quarters of its depth away at most."""
AROUND = 2
"""Nodes before a place, and after it, with which it is compared: of what one camera sees from one node a third has a
depth, and of that a tenth is recognised where the view is turned by 25 degrees: 8 points by themselves, 17 together."""
MAX_OFF, INLIER = 2.0, 4.0
"""Deviations of a feature: from an epipolar line, and from the point where rays meet."""
MIN_SIGNIFICANCE = 3.0
"""Deviations of its inverse depth from which on a feature has one: far ones still say how the camera is turned."""


def with_depths(camera: LoopCamera, nodes: tuple[Node, ...]) -> tuple[Node, ...]:
    """With those of the newest node's features, and those that it gives earlier ones.

    The node OTHERS before it is met with all that came since, too: that knows another half of its features. So is its
    parent, where nothing was before that. Nothing is met across a blind start: what the way is there only the loops
    will tell.
    """
    newest, before = nodes[-1], _before(nodes)
    if not before:
        return nodes
    found = {newest.time_ns: _met(camera, newest, before)}
    if len(before) == OTHERS:
        found[before[-1].time_ns] = _met(camera, before[-1], [newest, *before[:-1]])
    elif not np.isfinite(before[0].sight.xyz).any():
        found[before[0].time_ns] = _met(camera, before[0], [newest])
    return tuple(replace(n, sight=found[n.time_ns]) if n.time_ns in found else n for n in nodes)


def _before(nodes: tuple[Node, ...]) -> list[Node]:
    """OTHERS at most before the newest one, the nearest first, where the steps to it say that they are."""
    last, found = nodes[-1], list[Node]()
    while len(found) < OTHERS and last.seen and last.parent_ns != last.time_ns:
        parent = node_at(nodes, last.parent_ns)
        last = replace(parent, odometry=last.odometry @ step_between(parent, last)[0].pose.inverse())
        found.append(last)
    return found


def surroundings(nodes: tuple[Node, ...], place: Node) -> DescribedPoints:
    """What a place shows and the AROUND nodes before and after it do, all that has a depth, in the place's camera."""
    at = next(i for i, n in enumerate(nodes) if n.time_ns == place.time_ns)
    others, last = _before(nodes[: at + 1])[:AROUND], place
    for node in nodes[at + 1 : at + 1 + AROUND]:
        if not node.seen or node.parent_ns != last.time_ns:
            break
        last = replace(node, odometry=last.odometry @ step_between(last, node)[0].pose)
        others.append(last)
    shown = [n.sight.with_depth() for n in (place, *others)]
    ways = [place.odometry.inverse() @ n.odometry for n in (place, *others)]
    return replace(
        place.sight,
        x=np.concatenate([s.x for s in shown]),
        descriptors=np.concatenate([s.descriptors for s in shown]),
        xyz=np.concatenate([w.apply(s.xyz.astype(float)) for w, s in zip(ways, shown, strict=True)]).astype(np.float32),
    )


def _met(camera: LoopCamera, node: Node, others: list[Node]) -> DescribedPoints:
    """The node's with the points that it has in common with the others, beside those that were known."""
    sight = node.sight
    seen = [sight.x.astype(float), *(_seen(camera, node, other) for other in others)]
    stacked = np.stack(seen)
    owners, cameras = np.nonzero(np.isfinite(stacked[:, :, 0]).T)
    poses = [n.odometry.inverse() for n in (node, *others)]
    turns, ways = np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses])
    found = intersect(turns, ways, cameras, owners, stacked[cameras, owners], len(sight.x), Noise(camera.sigma))
    good = (found.depth > 0) & (found.worst < INLIER * camera.sigma) & (found.significance > MIN_SIGNIFICANCE)
    xyz = np.where(good[:, None], poses[0].apply(found.xyz_in_world), sight.xyz)
    return replace(sight, xyz=xyz.astype(np.float32))


def _seen(camera: LoopCamera, node: Node, other: Node) -> Array:
    """(N, 2) normalised, where another node has a node's features: the most alike on their epipolar lines, or NaN."""
    here, there = node.sight.features(camera.fx), other.sight.features(camera.fx)
    motion = other.odometry.inverse() @ node.odometry
    allowed = on_epipolar_lines(motion, node.sight.x, other.sight.x, MAX_OFF * camera.sigma)
    pairs, _ = camera.matcher.match_where(here, there, allowed)
    out = np.full((len(here), 2), np.nan)
    out[pairs[:, 0]] = other.sight.x[pairs[:, 1]]
    return out
