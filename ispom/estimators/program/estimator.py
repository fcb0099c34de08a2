"""A method that is a program in any language.

Its State is a value: poses, tracks, and either the state that the program saved, or the frames that it received. If
the estimator steps from another State than the program's, the program restores what it saved. A program that saves
nothing is started again and receives all frames from the first. So changed settings take effect from that frame on in a
program that saves its state, and from the first frame on in one that does not.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from hashlib import blake2b
from time import perf_counter
from typing import Annotated, Any, ClassVar

from ispom.errors import InputError
from ispom.estimator import Method
from ispom.estimators.program import validate
from ispom.estimators.program.pipe import Pipe, ProgramFault
from ispom.estimators.program.protocol import (
    Description,
    greet,
    images_of,
    read_step,
    restore_request,
    start_request,
    step_request,
)
from ispom.estimators.program.store import STORE, StoredFrame
from ispom.geometry import Pose
from ispom.persistent_list import PersistentList
from ispom.settings import Range, checked
from ispom.types import FrameName, Kind, Measurement, Rig, Step, Tracks, TrackStatus, Trajectory


@dataclass(frozen=True)
class ProgramConfig:
    """Base class of the settings of such a method, which adds a name, a command and the program's own settings."""

    name: ClassVar[str] = ""
    """Name of the method."""
    command: ClassVar[tuple[str, ...]] = ()
    """The program and its arguments, started without a shell. No setting: no page and no run folder shows it."""

    timeout_s: Annotated[float, Range(10, 3600)] = 60.0
    """The program is killed if it takes longer to start or to answer about a frame [s]."""
    replay_mb: Annotated[int, Range(0, 100_000)] = 2000
    """Temporary disk space for past frames [MB], to go back in a run of a program that saves no state. Such a
    program gets them again from the start, so changed settings act from there; beyond this size, no going back."""

    def build(self, rig: Rig) -> Program:
        return Program(checked(self), rig)

    @property
    def program_settings(self) -> dict[str, Any]:
        """The settings that are sent to the program."""
        own = {f.name for f in fields(ProgramConfig)}
        return {name: value for name, value in asdict(self).items() if name not in own}


STATE_BYTES = 256 << 20
"""The largest state that a program may save."""


@dataclass(frozen=True, eq=False)
class State:
    """What is kept from frame to frame."""

    count: int = 0
    """Number of frames received."""
    chain: bytes = b""
    """A digest of all of them."""
    saved: bytes | None = field(default=None, repr=False)
    """The program's own state; None before the first frame, and where it saves none."""
    seen: PersistentList[StoredFrame] = PersistentList()
    """The frames, where the program saves no state."""
    poses: PersistentList[tuple[int, Pose]] = PersistentList()
    frame: FrameName = "rig"
    tracks: Mapping[str, Tracks] = field(default_factory=dict)
    """By camera, the tracks alive in its last frame."""
    ids: Mapping[str, int] = field(default_factory=dict)
    """By camera, the first id that no track had."""

    @property
    def mark(self) -> bytes:
        """Identifies the history of a program that can step on from here."""
        return self.chain if self.saved is None else self.saved


@dataclass(frozen=True, eq=False)
class _Running:
    pipe: Pipe
    described: Description
    mark: bytes = b""
    """The mark in the State that the program has now."""


class Program:
    """Starts the program at the first step, and whenever it has to begin again."""

    def __init__(self, config: ProgramConfig, rig: Rig) -> None:
        self._config, self._rig = config, rig
        self._pipe: Pipe | None = None
        self._running: _Running | None = None

    def start(self) -> State:
        return State()

    def step(self, state: State, exposure: Measurement) -> tuple[State, Step]:
        """Sends the frame to the program and checks its answer.

        Raises InputError, with the program's last line on standard error, for any fault of the program.
        """
        begun = perf_counter()
        try:
            running = self._at(state)
            content = step_request(state.count, exposure, running.described.grey)
            answer, saved = _exchange(running, content)
            cameras = {name: self._rig.camera(name) for name in images_of(exposure)}  # type: ignore[arg-type]
            step = read_step(answer, exposure.time_ns, running.described.checks, cameras, state.tracks, state.ids)
            step = replace(step, frame=running.described.frame, seconds={"program": perf_counter() - begun})
            after = self._after(state, step, content, saved)
            self._running = replace(running, mark=after.mark)
        except ProgramFault as fault:
            self._stop()
            where = f"at frame {state.count} of those that it was given"
            raise InputError(fault_message(self._config, fault, where, self._pipe)) from None
        except BaseException:  # in the middle of an exchange
            self._stop()
            raise
        return after, step

    def finish(self, state: State) -> Trajectory:
        return Trajectory.of(list(state.poses), state.frame)

    def _after(self, state: State, step: Step, content: bytes, saved: bytes | None) -> State:
        digest = blake2b(content, digest_size=16).digest()
        seen, poses = state.seen, state.poses
        if saved is None:
            seen = seen.appended(STORE.keep(digest, content, self._config.replay_mb))
        if step.world_from_frame is not None:
            poses = poses.appended((step.time_ns, step.world_from_frame))
        alive = {name: _alive(tracks) for name, tracks in step.tracks.items()}
        highest = {name: int(tracks.ids.max(initial=-1)) + 1 for name, tracks in step.tracks.items()}
        return State(
            count=state.count + 1,
            chain=blake2b(state.chain + digest, digest_size=16).digest(),
            saved=saved,
            seen=seen,
            poses=poses,
            frame=step.frame,
            tracks={**state.tracks, **alive},
            ids={**state.ids, **{name: max(first, state.ids.get(name, 0)) for name, first in highest.items()}},
        )

    def _at(self, state: State) -> _Running:
        """Returns the program in the given State: the running one, or one that restores or repeats the State."""
        running = self._running
        if running is not None and running.mark == state.mark:
            return running
        if state.saved is not None:
            running = running or self._started()
            validate.known(running.pipe.request(restore_request(state.saved)), (), "the answer to restore")
        else:
            running = self._started()
            for seen_image in state.seen:
                if (content := STORE.read(seen_image.digest)) is None:
                    raise InputError(
                        f"{self._config.name} cannot go back to frame {state.count} of those that it was given, for "
                        f"its program saves no state: give more --{self._config.name}.replay-mb than "
                        f"{self._config.replay_mb}, or run again"
                    )
                _exchange(running, content)
        return running

    def _started(self) -> _Running:
        self._stop()
        self._pipe = pipe = Pipe(self._config.command, self._config.timeout_s)
        weakref.finalize(self, pipe.stop)
        running = _Running(pipe, greet(pipe))
        validate.known(pipe.request(start_request(self._rig, self._config.program_settings)), (), "the answer to start")
        self._running = running
        return running

    def _stop(self) -> None:
        """Stops the program; the pipe keeps its last line on standard error."""
        self._running = None
        if self._pipe is not None:
            self._pipe.stop()


def fault_message(
    config: type[ProgramConfig] | ProgramConfig, fault: ProgramFault, where: str, pipe: Pipe | None
) -> str:
    """Returns a fault as a sentence; the program must have been stopped."""
    last = pipe.last_line() if pipe else ""
    quoted = f" (its last line on standard error: {last})" if last and last not in str(fault) else ""
    return f"{config.name}: its program {fault}, {where}{quoted}: mend the program, or choose other methods"


def _exchange(running: _Running, content: bytes) -> tuple[dict[str, Any], bytes | None]:
    """Returns the answer about a frame, and the state that was saved after it."""
    answer, saves = running.pipe.request(content), running.described.saves
    if saves != ("state_bytes" in answer):
        raise ProgramFault(f"answers {'without' if saves else 'with'} state_bytes, but said that saves is {saves}")
    if not saves:
        return answer, None
    return answer, running.pipe.read_bytes(validate.count(answer["state_bytes"], "state_bytes", STATE_BYTES))


def _alive(tracks: Tracks) -> Tracks:
    followed = tracks.status < TrackStatus.LOST
    return Tracks.of(tracks.ids[followed], tracks.uv[followed])


def program_method(config: type[ProgramConfig], needs: Iterable[Kind]) -> Method:
    """Starts a program once to learn what it computes; returns its method. Raises InputError where that fails."""
    pipe = Pipe(config.command, config().timeout_s)
    try:
        described = greet(pipe)
    except ProgramFault as fault:
        pipe.stop()
        raise InputError(fault_message(config, fault, "when it was greeted", pipe)) from None
    finally:
        pipe.stop()
    return Method(config.name, frozenset(needs), config, described.unit, described.source, checks=described.checks)
