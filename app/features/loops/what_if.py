"""What would have come of the opposite decision: an exact fork of the run, from the frame before the later image."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal
from zlib import crc32

import numpy as np
from scipy.spatial.transform import Rotation

from ispom.errors import InputError
from ispom.estimators.modern.loops.asked import Pair, pair_text
from ispom.estimators.modern.trials import Trial, collecting_trials
from ispom.geometry import rotation_angle_rad
from ispom.methods import Config
from ispom.types import Step, Trajectory

from ...engine.differences.compare import step_row
from ...engine.playback import Playback, Snapshot
from .candidate import Candidate, Side, WhatIf, candidate_of, verdict_of
from .truth import errors_ate

Frames = tuple[int, int]


@dataclass(eq=False)
class Question:
    """One that was asked by --what-if: frames of candidates that are decided the other way together."""

    pairs: tuple[Frames, ...]
    snapshot: Snapshot | None = None
    """Of the run, before the first of the later frames."""
    found: Candidate | None = None
    """The first of the candidates, as the run decided it."""

    @property
    def start(self) -> int:
        """The first frame that may differ."""
        return min(then for _, then in self.pairs)

    @property
    def text(self) -> str:
        return ",".join(f"{first}-{then}" for first, then in self.pairs)


def question_of(text: str, frames: int) -> Question:
    """Reads FIRST-THEN[,FIRST-THEN...]. Raises InputError for what is none, or frames that are not in the run."""
    pairs = list[Frames]()
    for part in text.split(","):
        first, _, then = part.partition("-")
        if not (first.isdecimal() and then.isdecimal() and int(first) < int(then)):
            raise InputError(f"--what-if is {text[:60]!r}: give two frames, the earlier one first, as in 12-340")
        if int(then) >= frames:
            raise InputError(f"--what-if is {text[:60]!r}, and the run has the frames 0 to {frames - 1}: give those")
        pairs.append((int(first), int(then)))
    return Question(tuple(pairs))


class Recent:
    """What was accepted, and the last Steps of each method, by frame: what two runs are compared by."""

    def __init__(self, start: int) -> None:
        self._start = start
        self.closed = list[tuple[int, str]]()
        self.digests = dict[int, int]()
        """Of the Steps of a frame, without wall times."""

    def add(self, index: int, steps: Sequence[Step], accepted: Sequence[str]) -> None:
        """Of a frame; what is before the start is the same anyway."""
        if index >= self._start:
            rows = [tuple(step_row(index, step, None).values.items()) for step in steps]
            self.digests[index] = crc32(repr(rows).encode())
            self.closed += [(index, text) for text in accepted]

    def closed_since(self, index: int) -> tuple[str, ...]:
        return tuple(text for at, text in self.closed if at >= index)


def accepted_in(playback: Playback, trials: Sequence[Trial]) -> list[str]:
    """The candidates among these that are accepted: FIRST-THEN."""
    return [candidate_of(one, playback.sequence).pair for one in trials if verdict_of(one) == "accepted"]


def answer(
    question: Question,
    as_it_was: Playback,
    before: Recent,
    final: Mapping[str, Trajectory],
    advance: Callable[[], None],
) -> WhatIf:
    """Runs the fork to its end, and compares it with the run. Raises InputError for a candidate that the run lacks."""
    found, snapshot = question.found, question.snapshot
    if found is None or snapshot is None:
        raise InputError(f"--what-if: no loop, join or relocalisation {question.text} was a candidate of the run")
    if found.kind == "relocalisation":
        raise InputError(
            f"--what-if: {question.text} is a relocalisation: only loops and joins can be decided otherwise"
        )
    asked: Literal["refuse", "accept"] = "refuse" if found.verdict == "accepted" else "accept"
    method, times_ns = found.method, as_it_was.sequence.times_ns
    pairs = tuple((int(times_ns[a]), int(times_ns[b])) for a, b in question.pairs)
    config, setting = otherwise(as_it_was.config, method, asked, pairs)
    fork = as_it_was.forked(question.start, as_it_was.methods, config, snapshot)
    after, said = Recent(question.start), False
    while fork.more():
        with collecting_trials() as trials:
            event = fork.step()
        after.add(event.index, event.steps, accepted_in(fork, list(trials.values())))
        said |= any(d.key == "loop_asked" for step in event.steps for d in step.decisions)
        advance()
    finished = fork.finish().trajectories
    apart = [i for i, digest in after.digests.items() if before.digests.get(i) != digest]
    shift, at = _largest_shift(final[method], finished[method])
    return WhatIf(
        tuple(f"{a}-{b}" for a, b in question.pairs),
        method,
        asked,
        said,
        question.start,
        min(apart, default=None),
        shift,
        int(np.searchsorted(times_ns, at)),
        _side(as_it_was, method, final, found, before.closed_since(question.start)),
        _side(as_it_was, method, finished, found, after.closed_since(question.start)),
        setting,
    )


def otherwise(config: Config, method: str, asked: str, pairs: tuple[Pair, ...]) -> tuple[Config, str]:
    """Returns the config with the opposite decision about these pairs, and the flag that has it."""
    settings: Any = config.of(method)
    refused, accepted = _listed(settings.refuse_loops, pairs), _listed(settings.accept_loops, pairs)
    texts = [pair_text(pair) for pair in pairs]
    if asked == "refuse":
        refused += texts
    else:
        accepted += texts
    changed = replace(settings, refuse_loops=",".join(refused), accept_loops=",".join(accepted))
    return config.with_settings(method, changed), f"--{method}.{asked}-loops {','.join(texts)}"


def _listed(text: str, without: tuple[Pair, ...]) -> list[str]:
    gone = {pair_text(pair) for pair in without}
    return [part for each in text.split(",") if (part := each.strip()) and part not in gone]


def _side(
    playback: Playback, method: str, final: Mapping[str, Trajectory], found: Candidate, closed: tuple[str, ...]
) -> Side:
    trajectory = final[method]
    ate = errors_ate(playback, {method: trajectory}).get(method)
    distance = turn = None
    if found.pose is not None:
        rig = playback.sequence.rig
        frame_from_camera = rig.rig_from(trajectory.frame).inverse() @ rig.rig_from(found.camera)
        poses = [trajectory.at(t) for t in (found.first_ns, found.then_ns)]
        first, then = (None if pose is None else pose @ frame_from_camera for pose in poses)
        if first is not None and then is not None:
            moved, measured = first.inverse() @ then, np.array(found.pose.translation)
            distance = float(np.linalg.norm(moved.translation - measured))
            rotation = Rotation.from_quat(found.pose.rotation_xyzw).as_matrix()
            turn = float(np.degrees(rotation_angle_rad(moved.rotation.T @ rotation)))
    return Side(None if ate is None else ate[0], distance, turn, len(trajectory), closed)


def _largest_shift(one: Trajectory, other: Trajectory) -> tuple[float, int]:
    """The largest distance of the positions at a common time, and that time."""
    common, a, b = np.intersect1d(one.times_ns, other.times_ns, return_indices=True)
    if not len(common):
        return 0.0, 0
    apart = np.linalg.norm(one.translations[a] - other.translations[b], axis=1)
    worst = int(np.argmax(apart))
    return float(apart[worst]), int(common[worst])
