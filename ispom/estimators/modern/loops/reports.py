"""Reports the candidates of loops that are dropped before or after they are compared, to whoever collects trials."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import AbstractContextManager

from ispom.estimators.modern import trials
from ispom.estimators.modern.loops.find import COMPARED, LEAST_NODES, reach, similarity
from ispom.estimators.modern.loops.nodes import Loop, Node
from ispom.estimators.modern.loops.relative_pose import LoopCamera, RelativePose
from ispom.estimators.modern.trials import judged, trial
from ispom.types import Decision


def loop_trial(camera: LoopCamera, first_ns: int, then_ns: int) -> AbstractContextManager[None]:
    """Returns a context in which reports are about this candidate of a loop."""
    return trial("loop", "left" if camera.baseline else "video", first_ns, then_ns)


def report_candidates(camera: LoopCamera, nodes: tuple[Node, ...], node: Node, drift: float) -> None:
    """Reports which of the earlier nodes are within reach of a new one, and which of those look most similar."""
    if not trials.is_collecting():
        return
    near = list[tuple[float, int]]()
    for candidate in nodes[: -LEAST_NODES + 1]:
        apart, limit = reach(candidate, node, drift)
        with loop_trial(camera, candidate.time_ns, node.time_ns):
            if judged(apart <= limit, trials.REACH, apart, limit):
                near.append((-similarity(candidate, node), candidate.time_ns))
    for rank, (_, time_ns) in enumerate(sorted(near), 1):
        with loop_trial(camera, time_ns, node.time_ns):
            judged(rank <= COMPARED, trials.RANK, rank, COMPARED)


def report_not_compared(camera: LoopCamera, waiting: tuple[int, ...], then_ns: int, compared: int) -> None:
    """Reports the candidates that are discarded without a comparison, after `compared` others were compared."""
    for i, first_ns in enumerate(waiting):
        with loop_trial(camera, first_ns, then_ns):
            judged(False, trials.TURN, compared + 1 + i, compared)


def report_best(
    camera: LoopCamera, found: list[tuple[Node, RelativePose]], best: tuple[Node, RelativePose], then: Node
) -> None:
    """Reports the candidates that match fewer points than the best one."""
    for node, relative in found:
        with loop_trial(camera, node.time_ns, then.time_ns):
            judged(node is best[0], trials.BEST, relative.count, best[1].count)


def report_loops(camera: LoopCamera, loops: Iterable[Loop], decision: Decision, accepted: bool) -> None:
    """Reports a decision about these loops."""
    for loop in loops:
        with loop_trial(camera, loop.first_ns, loop.then_ns):
            trials.report_decision(decision)
            if accepted:
                trials.report_accepted()
