"""The estimator of a method that is a program.

Its State is a value: poses, tracks, and either the state that the program saved, or what it has seen. Where it is
stepped on from a State that is not where the program is, the program restores what it saved; one that saves nothing
is started again, and sees all frames from the first. So settings that were changed on the way act from there in a
program that saves, and from the start in one that does not.
"""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from time import perf_counter
from typing import Any

from ispom.errors import InputError
from ispom.estimators.program import plain, requests
from ispom.estimators.program.answer import read_step
from ispom.estimators.program.config import ProgramConfig
from ispom.estimators.program.description import Description, greeted
from ispom.estimators.program.pipe import Pipe, ProgramFault
from ispom.estimators.program.store import STORE, Kept
from ispom.geometry import Pose
from ispom.persistent_list import PersistentList
from ispom.types import FrameName, Measurement, Rig, Step, Tracks, TrackStatus, Trajectory, images_of

STATE_BYTES = 256 << 20
"""The largest state that a program may save."""


@dataclass(frozen=True, eq=False)
class State:
    count: int = 0
    """Frames seen."""
    chain: bytes = b""
    """A digest of all of them."""
    saved: bytes | None = field(default=None, repr=False)
    """The program's own state; None before the first frame, and where it saves none."""
    seen: PersistentList[Kept] = PersistentList()
    """The frames, where the program saves no state."""
    poses: PersistentList[tuple[int, Pose]] = PersistentList()
    frame: FrameName = "rig"
    tracks: Mapping[str, Tracks] = field(default_factory=dict)
    """By camera, those of its last frame that had not ended."""
    ids: Mapping[str, int] = field(default_factory=dict)
    """By camera, the first id that no track had."""

    @property
    def mark(self) -> bytes:
        """What a program that was built with the same settings has to have come through to step on from here."""
        return self.chain if self.saved is None else self.saved


@dataclass(frozen=True, eq=False)
class _Running:
    pipe: Pipe
    described: Description
    mark: bytes = b""
    """Of the State that it is in."""


class Program:
    """Starts the program when it is first stepped, and whenever it has to begin again."""

    def __init__(self, config: ProgramConfig, rig: Rig) -> None:
        self._config, self._rig = config, rig
        self._pipe: Pipe | None = None
        self._running: _Running | None = None

    def start(self) -> State:
        return State()

    def step(self, state: State, measurement: Measurement) -> tuple[State, Step]:
        """InputError, which names the program's last line on standard error, for whatever is wrong with it."""
        begun = perf_counter()
        try:
            running = self._at(state)
            content = requests.step(state.count, measurement, running.described.grey)
            answer, saved = _exchange(running, content)
            cameras = {name: self._rig.camera(name) for name in images_of(measurement)}  # type: ignore[arg-type]
            found = read_step(answer, measurement.time_ns, running.described.checks, cameras, state.tracks, state.ids)
            found = replace(found, frame=running.described.frame, seconds={"program": perf_counter() - begun})
            after = self._after(state, found, content, saved)
            self._running = replace(running, mark=after.mark)
        except ProgramFault as fault:
            self._stop()
            where = f"at frame {state.count} of those that it was given"
            raise InputError(explained(self._config, fault, where, self._pipe)) from None
        except BaseException:  # in the middle of an exchange
            self._stop()
            raise
        return after, found

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
            state.count + 1,
            blake2b(state.chain + digest, digest_size=16).digest(),
            saved,
            seen,
            poses,
            step.frame,
            {**state.tracks, **alive},
            {**state.ids, **{name: max(first, state.ids.get(name, 0)) for name, first in highest.items()}},
        )

    def _at(self, state: State) -> _Running:
        """The program as it is after what the State has seen."""
        running = self._running
        if running is not None and running.mark == state.mark:
            return running
        if state.saved is not None:
            running = running or self._started()
            plain.known(running.pipe.ask(requests.restore(state.saved)), (), "the answer to restore")
        else:
            running = self._started()
            for kept in state.seen:
                if (content := STORE.read(kept.digest)) is None:
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
        running = _Running(pipe, greeted(pipe))
        plain.known(pipe.ask(requests.start(self._rig, self._config.of_program)), (), "the answer to start")
        self._running = running
        return running

    def _stop(self) -> None:
        """The pipe still knows the program's last words."""
        self._running = None
        if self._pipe is not None:
            self._pipe.stop()


def explained(config: type[ProgramConfig] | ProgramConfig, fault: ProgramFault, where: str, pipe: Pipe | None) -> str:
    """A fault as a sentence; the program has been stopped."""
    last = pipe.last_line() if pipe else ""
    heard = f" (its last line on standard error: {last})" if last and last not in str(fault) else ""
    return f"{config.name}: its program {fault}, {where}{heard}: mend the program, or choose other methods"


def _exchange(running: _Running, content: bytes) -> tuple[dict[str, Any], bytes | None]:
    """The answer about a frame, and the state that was saved after it."""
    answer, saves = running.pipe.ask(content), running.described.saves
    if saves != ("state_bytes" in answer):
        raise ProgramFault(f"answers {'without' if saves else 'with'} state_bytes, but said that saves is {saves}")
    if not saves:
        return answer, None
    return answer, running.pipe.follow(plain.count(answer["state_bytes"], "state_bytes", STATE_BYTES))


def _alive(tracks: Tracks) -> Tracks:
    kept = tracks.status < TrackStatus.LOST
    return Tracks.of(tracks.ids[kept], tracks.uv[kept])
