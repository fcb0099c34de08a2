"""Numba's first compilation, in separate processes on all cores: in this process it would block the page.

`start(methods, config)` begins where machine code is missing; `while not ready(methods, config, 0.05): say(message())`
comes before the first frame is computed. Numba stores each kernel as soon as it is compiled. So an interrupted start
loses only the kernels that were being compiled.
"""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass, field

import psutil

from ispom import compiled_code
from ispom.child import PYTHON, Child
from ispom.kernel_list import kernel_list, kernels_of
from ispom.methods import BUILT_IN, Config, with_dependencies

log = logging.getLogger(__name__)
MESSAGE = "Compiling the estimators once for this computer"
COMMAND = [*PYTHON, "-m", "ispom.warm_up"]
DEFAULT = tuple(name for name in BUILT_IN if not name.endswith(".paper"))
"""Methods that most sources are run with. They are compiled in advance while nobody has chosen methods."""
MOST_PROCESSES = 4
"""A process takes 350 MB, and the longest kernel a fifth of the whole time."""
KEPT_S = 0.05
"""Assumed time of a kernel that is compiled already."""
PRIOR_S = 3.0
"""Weight of the prior that this machine is as fast as the one that wrote the list of kernels, as a running time."""


@dataclass
class Work:
    """One kernel that is being compiled by a process, and the CPU time that the process had taken before."""

    process: psutil.Process
    before_s: float

    @staticmethod
    def begun(pid: int) -> Work:
        process = psutil.Process(pid)
        return Work(process, _cpu_s(process))

    @property
    def taken_s(self) -> float:
        """CPU time so far."""
        return _cpu_s(self.process) - self.before_s


@dataclass
class Compilation:
    """The kernels to compile and the progress. `changed` guards all fields."""

    changed: threading.Condition = field(default_factory=threading.Condition)
    waiting: list[str] = field(default_factory=list)
    """Kernels whose compilation has not begun, the next one first."""
    working: dict[str, Work] = field(default_factory=dict)
    done: set[str] = field(default_factory=set)
    """Requested kernels that are compiled."""
    kept: frozenset[str] = frozenset()
    """Kernels that an earlier start compiled: they take no time."""
    processes: int = 0
    gentle: bool = False
    """Whether processes are started with low priority."""
    begun_s: float = 0.0
    """When it was begun, of time.monotonic()."""
    taken_s: float = 0.0
    """CPU time for what is done."""
    failures: list[str] = field(default_factory=list)
    """One sentence, where it failed: it is not tried again in this process."""

    def ask(self, wanted: Iterable[str]) -> None:
        """Compiles these before all others that wait, the longest first."""
        with self.changed:
            if self.failures:
                return
            missing = compiled_code.missing(set(wanted) - self.done - self.working.keys())
            if not missing:
                return
            if not self.processes:
                self.begun_s, self.taken_s, self.done = time.monotonic(), 0.0, set()
            self.kept |= compiled_code.kept(missing - self.kept)
            first = sorted(missing, key=lambda name: (-self._cost_s(name), name))
            self.waiting = first + [name for name in self.waiting if name not in missing]
            while self.processes < min(_cores(), MOST_PROCESSES, len(self.waiting)):
                self.processes += 1
                threading.Thread(target=self._work, name="compile", daemon=True).start()

    def over(self, wanted: frozenset[str] | None, wait_s: float = 0.0) -> bool:
        """Returns whether all of these kernels (None: all requested ones) are compiled; waits up to `wait_s`."""

        def nothing_left() -> bool:
            left = [*self.waiting, *self.working]
            return not left if wanted is None else wanted.isdisjoint(left)

        with self.changed:
            return self.changed.wait_for(nothing_left, wait_s)

    def progress(self, wanted: frozenset[str] | None) -> tuple[float, float]:
        """Returns the share of these kernels that is compiled, 0..1, and the seconds for the rest at the speed so
        far."""
        with self.changed:
            running_s, processes = time.monotonic() - self.begun_s, max(self.processes, 1)
            compiled_s = sum(map(self._cost_s, self.done))
            per_cpu = (PRIOR_S + compiled_s) / (PRIOR_S + self.taken_s)
            left_s = {name: self._cost_s(name) for name in self.waiting}
            for name, work in self.working.items():
                cost = self._cost_s(name)
                left_s[name] = max(cost - work.taken_s * per_cpu, 0.05 * cost)
                compiled_s += cost - left_s[name]
            speed = (PRIOR_S * processes + compiled_s) / (PRIOR_S + running_s)  # of all processes together
            among = {*left_s, *self.done} if wanted is None else wanted
            left = {name: seconds for name, seconds in left_s.items() if name in among}
            whole = sum(kernel_list()[name].seconds for name in among)
            at_once = max(sum(left.values()) / speed, max(left.values(), default=0.0) * processes / speed)
            return 1.0 - min(1.0, sum(left.values()) / max(whole, 1e-9)), at_once

    def _cost_s(self, name: str) -> float:
        return KEPT_S if name in self.kept else kernel_list()[name].seconds

    def _work(self) -> None:
        """Runs one compiling process in this thread, until no kernel is left."""
        child: Child | None = None
        try:
            child = Child([*COMMAND, "--gentle"] if self.gentle else COMMAND)
            while name := self._next(child):
                child.requests.write(f"{name}\n".encode())
                child.requests.flush()
                if child.answers.readline().decode().strip() != name:
                    raise BrokenPipeError(f"the process gave no answer to {name}")
                with self.changed:
                    if (work := self.working.pop(name, None)) is not None:
                        self.taken_s += work.taken_s
                    self.done.add(name)
                    self._mark()
                    self.changed.notify_all()
        except OSError as fault:
            self._failed(
                f"the process {child.ending()}" if child is not None and child.wait(1.0) else str(fault), child
            )
        finally:
            if child is not None:
                child.stop()

    def _next(self, child: Child) -> str | None:
        with self.changed:
            if not self.waiting or self.failures:
                self.processes -= 1
                return None
            name = self.waiting.pop(0)
            self.working[name] = Work.begun(child.pid)
            return name

    def _mark(self) -> None:
        """Writes down the compiled kernels whenever all requested ones are compiled."""
        if not self.working and not self.waiting:
            compiled_code.mark_complete(self.done)

    def _failed(self, how: str, child: Child | None) -> None:
        """Gives up the compilation for all processes, at the first failure."""
        with self.changed:
            self.processes -= 1
            self.waiting.clear()
            self.working.clear()
            if not self.failures:
                sentence = (
                    f"the estimators could not be compiled in advance ({how}): each compiles at its first use, "
                    "which delays its first frames"
                )
                self.failures.append(sentence)
                words = child.last_words() if child is not None else ""
                log.warning("\n".join(filter(None, [sentence, words])))
            self.changed.notify_all()


_compilation = Compilation()


def kernels_needed(methods: Iterable[str], config: Config) -> frozenset[str]:
    """Returns the kernels of this package that these methods run."""
    chosen = set(with_dependencies(methods))
    if "monocular.paper" in chosen and not config.of("monocular.paper").local_bundle:
        chosen.remove("monocular.paper")
    return kernels_of(chosen)


def start(methods: Iterable[str], config: Config, *, gentle: bool = False) -> None:
    """Begins to compile the missing kernels of these methods, before all other kernels that wait.

    `gentle`: compiles with low priority, because the user can look at something meanwhile.
    """
    _compilation.gentle = _compilation.gentle or gentle
    _compilation.ask(kernels_needed(methods, config))


def ready(methods: Iterable[str], config: Config, wait_s: float = 0.0) -> bool:
    """Returns whether these methods can run without waiting for the compilation; waits up to `wait_s`.

    This is also true where the compilation failed: missing kernels are compiled at their first use then.
    """
    return _compilation.over(kernels_needed(methods, config), wait_s)


def finished(wait_s: float = 0.0) -> bool:
    """Returns whether no compilation is going on; waits up to `wait_s` for its end."""
    return _compilation.over(None, wait_s)


def message(methods: Iterable[str] | None = None, config: Config | None = None) -> str:
    """Returns MESSAGE with the share that is compiled, and the time of the rest at the speed so far: for the kernels
    that these methods need, or for all requested ones."""
    wanted = None if methods is None else kernels_needed(methods, config or Config())
    share, left_s = _compilation.progress(wanted)
    return MESSAGE if _compilation.over(wanted) else f"{MESSAGE}: {100 * share:.0f} %, about {_rounded(left_s)} s"


def failure() -> str | None:
    """Returns one sentence where the compilation failed, else None. After a failure estimators compile at first use."""
    return _compilation.failures[-1] if _compilation.failures else None


def _rounded(seconds: float) -> int:
    """Rounds to steps of 5 s from 10 s on: the estimate is not more precise."""
    return max(1, round(seconds)) if seconds < 10 else 5 * round(seconds / 5)


def _cpu_s(process: psutil.Process) -> float:
    """The CPU time of a process; 0 of one that is gone."""
    try:
        times = process.cpu_times()
    except psutil.Error:
        return 0.0
    return times.user + times.system


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
