"""What moved the pose of one frame, with what people call its parts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ispom.errors import InputError
from ispom.methods import method as registered
from ispom.solvers.influence.blame import Blame, Influence, blame, problem_of
from ispom.solvers.influence.problem import PartKind, Problem, Shift
from ispom.solvers.influence.resection import ResectionProblem
from ispom.types import Rig, Sequence, Status, Step, Tracks

from ...engine.history.record import with_parts
from ...engine.inspection.sightings import camera_pose
from ...engine.playback import Playback
from ...engine.run_folder.placements import placed

Reported = Mapping[str, tuple[Step, tuple[Problem, ...]]]
"""By method: its Step, and the problems that it solved for it."""
ROWS, COLUMNS = ("upper", "middle", "lower"), ("left", "centre", "right")
"""Thirds of an image."""
LISTED: dict[PartKind, int] = {"group": 5, "track": 5, "frame": 4, "prior": 2, "sensor": 5}
"""How many of each kind people see; blame.csv has all."""


@dataclass(frozen=True, eq=False)
class PoseBlame:
    """Of a method at a frame."""

    method: str
    index: int
    step: Step
    """As the method gave it."""
    found: Blame
    sequence: Sequence
    unit_m: float | None
    """Of the method's world [m]; None where it is not known."""
    solver: str = ""
    """The method that this one takes the pose from; empty where it solved for it itself."""

    @property
    def camera(self) -> str:
        """Whose image the tracks are in."""
        return self.found.problem.frame

    @property
    def tracks(self) -> Tracks | None:
        return self._tracking.tracks.get(self.camera)

    @property
    def tracked_by(self) -> str:
        """The method whose tracks these are: this one, or one that it builds on."""
        return self._tracking.method

    @property
    def _tracking(self) -> Step:
        return next((step for step in with_parts((self.step,)) if self.camera in step.tracks), self.step)

    @property
    def by_known_points(self) -> bool:
        """Whether only the tracks of this frame took part, and the points were taken as known."""
        return isinstance(self.found.problem, ResectionProblem)

    @property
    def changed_since(self) -> float:
        """How far the method moved the camera after it had solved, by a rolling shutter or a loop, which it does not
        report."""
        given = camera_pose(self.step, self.sequence.rig, self.camera)
        return 0.0 if given is None else float(np.linalg.norm(given.translation - self.found.problem.pose.translation))

    def listed(self) -> tuple[Influence, ...]:
        """What people see: of each kind the largest, those of which something is known."""
        some = [each for kind, count in LISTED.items() for each in self.found.of(kind)[:count]]
        return tuple(each for each in some if np.isfinite(each.shift.size))

    def called(self, each: Influence) -> str:
        """What people call a part."""
        part = each.part
        if part.kind == "frame":
            return f"keyframe {self.index_of(part.time_ns or 0)}"
        if part.kind in ("prior", "sensor"):
            return part.name
        where = self.where(part.tracks)
        count = len(part.tracks)
        name = f"track {part.tracks[0]}" if count == 1 else f"{count} tracks"
        return f"{name} at the {where}" if where else f"{name}, no longer in the image"

    def where(self, ids: tuple[int, ...]) -> str:
        """The part of the image that tracks are in; empty where they are not in it."""
        if self.tracks is None:
            return ""
        uv = self.tracks.uv[np.isin(self.tracks.ids, ids)]
        if not len(uv):
            return ""
        camera = self.sequence.rig.camera(self.camera)
        u, v = np.clip(3 * np.median(uv, axis=0) / (camera.width, camera.height), 0, 2.999).astype(int).tolist()
        return f"{ROWS[v]} {COLUMNS[u]}" if (u, v) != (1, 1) else "centre"

    def index_of(self, time_ns: int) -> int:
        """The frame at a time."""
        return int(np.searchsorted(self.sequence.times_ns, time_ns))

    def between(self, other: Step) -> Shift | None:
        """From where another Step of the frame has the pose to where it is; None where that one has none."""
        rig, camera = self.sequence.rig, self.camera
        here, there = (camera_pose(step, rig, camera) for step in (self.step, other))
        if here is None or there is None:
            return None
        turned = (here.inverse() @ there).log()[3:]
        return Shift(here.translation - there.translation, turned)


def pose_blames(playback: Playback, methods: tuple[str, ...], units_m: Mapping[str, float]) -> list[PoseBlame]:
    """Of each of these methods that solved for a pose at the frame that the playback comes to next.

    `units_m` are those of the methods' worlds [m], where more is known than the playback knows by now. Raises
    InputError where no method did, with the reasons, or the frame cannot be read.
    """
    reported = playback.reported_problems()
    answers = [pose_blame(playback, reported, method, units_m) for method in methods]
    found = [each for each in answers if isinstance(each, PoseBlame)]
    reasons = [each for each in answers if isinstance(each, str)]
    if not found:
        raise InputError(f"{'; '.join(reasons) or 'no method runs'}: choose another frame or another method")
    return found


def pose_blame(playback: Playback, reported: Reported, method: str, units_m: Mapping[str, float]) -> PoseBlame | str:
    """Of one method, from what the playback's `reported_problems` gave; or why there is none.

    `units_m` as for `pose_blames`.
    """
    index = playback.position
    kind = playback.sequence.kinds[index]
    if method not in reported:
        return f"{method} does not use frame {index}, which is of the kind {kind}"
    step, problems = reported[method]
    if step.world_from_frame is None:
        return f"{method} has no pose at frame {index}, which is of the kind {kind}"
    solver = _taken_from(reported, method, playback.sequence.rig)
    problems = reported[solver][1] if solver else problems
    problem = problem_of(problems, step.world_from_frame, step.frame, playback.sequence.rig)
    if problem is None and step.status != Status.TRACKING:
        return f"{method} is {step.status} at frame {index} and has not solved for its pose"
    if problem is None:
        others = " and ".join(registered(method).asks.values())
        builds = f", but builds on {others}" if others else ""
        return f"{method} does not report what it solves for frame {index}{builds}"
    unit_m = units_m.get(method, playback.unit_m(method))
    return PoseBlame(method, index, step, blame(problem), playback.sequence, unit_m, solver)


def _taken_from(reported: Reported, method: str, rig: Rig) -> str:
    """The method that this one builds on and whose pose it has, such as that of `stereo` at a pair; empty for none."""
    own = camera_pose(reported[method][0], rig, "left")
    for other in registered(method).asks.values():
        step, problems = reported.get(other, (None, ()))
        given = None if step is None else camera_pose(step, rig, "left")
        if own is not None and given is not None and problems and np.allclose(own.matrix, given.matrix, 1e-9, 1e-9):
            return other
    return ""


def units_m(placements: Iterable[Mapping[str, Any]]) -> dict[str, float]:
    """By method: the unit of its world [m] as run.yaml has it, of the methods with a unit of their own."""
    return {method: placement.scale for _, method, placement in placed(placements) if placement.scale != 1.0}
