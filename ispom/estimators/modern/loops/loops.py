"""Loop closures on top of an odometry that they do not change: keyframes are matched, and a pose graph corrects all
poses.

Each frame compares at most AT_A_TIME candidates, optimises a graph of bounded size, and corrects a bounded number of
earlier poses.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ispom.errors import required
from ispom.estimators.modern.loops.asked import NOTHING_ASKED, Asked
from ispom.estimators.modern.loops.checks import LOOP_ASKED, LOOP_POINTS, LOOP_SHIFT, LOOP_VIEWS
from ispom.estimators.modern.loops.depths import surroundings, with_depths
from ispom.estimators.modern.loops.find import (
    MAJORITY,
    PAIR_DRIFT,
    SINGLE_DRIFT,
    VIEWS,
    WITHIN,
    agreeing,
    candidates,
    possible,
    within_drift,
)
from ispom.estimators.modern.loops.nodes import (
    APART_DEG,
    APART_DEPTHS,
    Loop,
    Node,
    edges_of,
    joined_segments,
    node_at,
    step_between,
    thinned,
    with_poses,
)
from ispom.estimators.modern.loops.relative_pose import FEWEST, DescribedPoints, LoopCamera, RelativePose, relative_pose
from ispom.estimators.modern.loops.reports import (
    loop_trial,
    report_best,
    report_candidates,
    report_loops,
    report_not_compared,
)
from ispom.geometry import Array, Pose, Similarity, rotation_angle_rad
from ispom.solvers.pose_graph import adjoint_sim3, optimise
from ispom.types import Decision

AT_A_TIME = 6
"""Number of candidates compared per frame, at 1-4 ms each, or 6-12 ms with the nodes around them; mostly the next node
comes after two frames."""


@dataclass(frozen=True, eq=False)
class KeyFrameSeen:
    """A new keyframe of the odometry."""

    time_ns: int
    world_from_camera: Pose
    covariance: Array | None
    """(6, 6) covariance of the right twist of world_from_camera."""
    scale_variance: float
    """Variance of ln scale; 0 for a pair."""
    window: Mapping[int, Pose]
    """world_from_camera of the keyframes in the window, or in the last window of this keyframe; includes the keyframe
    itself, oldest first."""
    describe: Callable[[], DescribedPoints]
    """Returns the described points of the keyframe; called only if they are needed."""
    joined: bool = True
    """Whether an observation connects it to the keyframes before; otherwise its pose is a guess across the gap."""
    segment: int | None = None
    """The segment of its pose. None: the parent's, or the next new one if no observation connects it."""


@dataclass(frozen=True, eq=False)
class Known:
    """The last node of the graph when it was optimised, with its covariance."""

    node: Node
    covariance: Array
    """(7, 7) covariance of its right perturbation."""

    def within(self, nodes: tuple[Node, ...]) -> Known:
        """Updates the pose of the node, whose window may still be optimised."""
        node = next((n for n in reversed(nodes) if n.time_ns == self.node.time_ns), self.node)
        return replace(self, node=node)


@dataclass(frozen=True, eq=False)
class Loops:
    nodes: tuple[Node, ...] = ()
    closed: tuple[Loop, ...] = ()
    proposed: tuple[Loop, ...] = ()
    """Loops measured by single views of the last nodes, not confirmed yet."""
    waiting: tuple[int, ...] = ()
    """Times of the candidates with which the newest node has not been compared yet."""
    compared: int = 0
    """Number of its candidates that it has been compared with."""
    known: Known | None = None
    uncorrected: int = 0
    """Number of poses still to be corrected, counted backwards from the one before `corrected_to`, and around to
    the end."""
    corrected_to: int = 0
    joins: int | None = None
    """The earlier segment that a loop joined with that of the newest node at the last frame."""
    end: int = 0
    """Number of poses when the graph was optimised: later ones were corrected when they were reported."""

    @property
    def correction(self) -> Similarity:
        """corrected_world_from_world of the newest pose."""
        return self.nodes[-1].correction if self.closed else Similarity()


def seen_again(
    loops: Loops, camera: LoopCamera, key: KeyFrameSeen | None, poses: int, asked: Asked = NOTHING_ASKED
) -> tuple[Loops, tuple[Decision, ...]]:
    """Updates the loops after a frame; `key` is its keyframe, if it is one, and `poses` the number of poses so far.
    Loops in `asked` are decided as a person requested."""
    drift, loops = PAIR_DRIFT if camera.baseline else SINGLE_DRIFT, replace(loops, joins=None)
    if key is not None:
        loops = _with_key(loops, camera, key, drift, asked)
    if not loops.waiting:
        return loops, ()
    then = loops.nodes[-1]
    compared = [node_at(loops.nodes, t) for t in loops.waiting[:AT_A_TIME]]
    relative_poses = _relative_poses(camera, loops.nodes, compared, then)
    loops = replace(loops, waiting=loops.waiting[AT_A_TIME:], compared=loops.compared + len(compared))
    found = [one for one in relative_poses if _possible(camera, *one, then, drift)]
    wanted = [one for one in relative_poses if (one[0].time_ns, then.time_ns) in asked.accepted]
    found = wanted or found
    points = LOOP_POINTS.of(max((relative.count for _, relative in found or relative_poses), default=0), FEWEST)
    if not found:
        why = "the odometry cannot have drifted that far" if relative_poses else ""
        return loops, (replace(points, passed=False, consequence=why),)
    first, relative = best = max(found, key=lambda one: one[1].count)
    report_best(camera, found, best, then)
    report_not_compared(camera, loops.waiting, then.time_ns, loops.compared)
    loop = Loop(first.time_ns, then.time_ns, relative.first_from_then, relative.covariance)
    if (loop.first_ns, loop.then_ns) in asked.refused:
        refused = LOOP_ASKED.of(0, 1)
        report_loops(camera, (loop,), refused, accepted=False)
        return replace(loops, waiting=()), (points, refused)
    loops = replace(loops, proposed=(*loops.proposed, loop), waiting=())
    same = agreeing(loops.nodes, loops.proposed, loop, drift)
    decision = LOOP_VIEWS.of(len(same), max(VIEWS, np.ceil(MAJORITY * len(loops.proposed))))
    if wanted:
        report_loops(camera, (loop,), decision, accepted=False)
        same, decision = (loop,), LOOP_ASKED.of(1, 1)
    if not decision.passed:
        report_loops(camera, (loop,), decision, accepted=False)
        return loops, (points, decision)
    report_loops(camera, [one for one in same if one not in loops.closed], decision, accepted=True)
    return _closed(loops, same, drift, bool(camera.baseline), poses, (points, decision))


def _possible(camera: LoopCamera, first: Node, relative: RelativePose, then: Node, drift: float) -> bool:
    with loop_trial(camera, first.time_ns, then.time_ns):
        return possible(first, then, relative.first_from_then, drift)


def _relative_poses(
    camera: LoopCamera, nodes: tuple[Node, ...], compared: list[Node], then: Node
) -> list[tuple[Node, RelativePose]]:
    """Returns the relative poses to the candidates that match a node. For one camera, which knows the depth of a third
    of its features, points of the nodes around a candidate are matched too."""
    found = list[tuple[Node, RelativePose]]()
    for candidate in compared:
        shown = candidate.described if camera.baseline else surroundings(nodes, candidate)
        with loop_trial(camera, candidate.time_ns, then.time_ns):
            relative = relative_pose(camera, shown, then.described, together=not camera.baseline)
        if relative is not None:
            found.append((candidate, relative))
    return found


def _with_key(loops: Loops, camera: LoopCamera, key: KeyFrameSeen, drift: float, asked: Asked) -> Loops:
    """Adds a node if the keyframe is far enough from the last one, with its loop candidates."""
    nodes = with_poses(loops.nodes, key.window, None if loops.known is None else loops.known.node.time_ns)
    known = None if loops.known is None else loops.known.within(nodes)
    unsure = np.zeros((6, 6)) if key.covariance is None else key.covariance
    if not nodes:
        first = Similarity(1.0, key.world_from_camera)
        node = Node(
            key.time_ns, key.time_ns, key.world_from_camera, unsure, key.scale_variance, 0.0, first, key.describe()
        )
        return replace(loops, nodes=(node,))
    before = [t for t in key.window if t < key.time_ns]
    # After a gap, the new node is attached to the last one; the step between them is a guess.
    parent = node_at(nodes, before[-1]) if key.joined and before else nodes[-1]
    between = parent.odometry.inverse() @ key.world_from_camera
    length = float(np.linalg.norm(between.translation))
    turn = float(np.degrees(rotation_angle_rad(between.rotation)))
    near = length < APART_DEPTHS * parent.described.depth and turn < APART_DEG
    if near and parent is nodes[-1] and key.joined:
        return replace(loops, nodes=nodes, known=known)
    node = Node(
        key.time_ns,
        parent.time_ns,
        key.world_from_camera,
        unsure,
        key.scale_variance,
        nodes[-1].path + length,
        parent.corrected @ Similarity(1.0, between),
        key.describe(),
        key.joined,
        _segment(nodes, parent, key),
        step=between,
    )
    report_not_compared(camera, loops.waiting, loops.nodes[-1].time_ns, loops.compared)
    report_candidates(camera, nodes, node, drift)
    wanted = asked.accepted_with(node.time_ns)
    waiting = (*wanted, *(t for t in candidates(nodes, node, drift) if t not in wanted))
    nodes = (*nodes, node) if camera.baseline else with_depths(camera, (*nodes, node))
    nodes, closed = thinned(nodes, loops.closed)
    kept = {n.time_ns for n in nodes}
    late = {n.time_ns for n in nodes[-WITHIN:]}
    proposed = tuple(p for p in loops.proposed if p.then_ns in late and p.first_ns in kept)
    waiting = tuple(t for t in waiting if t in kept)
    return replace(loops, nodes=nodes, closed=closed, proposed=proposed, waiting=waiting, known=known, compared=0)


def _segment(nodes: tuple[Node, ...], parent: Node, key: KeyFrameSeen) -> int:
    if key.joined:
        return parent.segment
    return key.segment if key.segment is not None else 1 + max(n.segment for n in nodes)


def _closed(
    loops: Loops,
    same: tuple[Loop, ...],
    drift: float,
    paired: bool,
    poses: int,
    decisions: tuple[Decision, ...],
) -> tuple[Loops, tuple[Decision, ...]]:
    """Adds these loops to the graph and optimises it."""
    newest, nodes = loops.nodes[-1], loops.nodes
    old = {x.then_ns: x for x in loops.closed}
    closed = tuple((old | {x.then_ns: x for x in same}).values())
    for loop in same:
        first, then = node_at(nodes, loop.first_ns), node_at(nodes, loop.then_ns)
        if first.segment != then.segment:
            nodes = joined_segments(nodes, loop, not within_drift(first, then, loop.first_from_then, drift))
    joins = nodes[-1].segment if nodes[-1].segment != newest.segment else None
    found = optimise(tuple(n.corrected for n in nodes), edges_of(nodes, closed), scaled=not paired)
    nodes = tuple(replace(n, corrected=c) for n, c in zip(nodes, found.nodes, strict=True))
    shift = np.linalg.norm(nodes[-1].corrected.pose.translation - newest.corrected.pose.translation)
    path = newest.path - node_at(nodes, same[-1].first_ns).path
    shifted = LOOP_SHIFT.of(float(shift) / max(path, 1e-9), drift)
    known, corrected_to = Known(nodes[-1], found.covariance), loops.corrected_to if loops.uncorrected else poses
    loops = replace(
        loops,
        nodes=nodes,
        closed=closed,
        known=known,
        uncorrected=poses,
        corrected_to=corrected_to,
        joins=joins,
        end=poses,
    )
    return loops, (*decisions, shifted)


def covariance_at(loops: Loops, world_from_camera: Pose, covariance: Array, scale_variance: float) -> Array:
    """Returns the covariance (7, 7) of the right perturbation of a corrected pose, once a loop was closed."""
    known = required(loops.known, "no loop was closed")
    node, at_node = known.node, known.covariance
    now = replace(node, odometry=world_from_camera, covariance=covariance, scale_variance=scale_variance)
    between, grown = step_between(node, now)
    adjoint = adjoint_sim3(between)
    return adjoint @ at_node @ adjoint.T + grown
