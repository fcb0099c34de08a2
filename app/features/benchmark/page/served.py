"""The app, as a process of its own, on a drive made long: it holds what a user's does.

`python -m ispom_app.features.benchmark.page.served '{...}'` waits for somebody to play the run, and prints what it took
as a line of JSON when it is over; with a branch, a second line when that is over.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ispom.child import end_with_parent
from ispom.io.tum import tum_text
from ispom.methods import default_methods
from ispom.sequences import open_sequence
from ispom.types import Sequence

from ....engine.conditions.until import Until
from ....engine.events import Finished
from ....engine.playback import Playback
from ....engine.run_folder.run_folder import RunFolder
from ....engine.signals import Signals
from ....session import commands as do
from ....session.session import Session
from ....views.web.server import Serving, serve
from ...branches.commands import Fork
from ...branches.state import Branches
from ...headless.job import Job
from ...headless.options import Run
from ...headless.play import Steps
from .drive import to_and_fro


@dataclass(frozen=True, kw_only=True)
class Served:
    """What is served."""

    source: str
    stereo_every: int = 1
    video_scale: float = 1.0
    exposures: int
    methods: tuple[str, ...] = ()
    """None given means the usual ones."""
    headless: bool = False
    """Run the same as `ispom run` does, too, exposure by exposure by turns."""
    branch_at: int | None = None
    """Fork there, with nothing changed, when the run is over."""

    def open(self) -> Sequence:
        drive = open_sequence(self.source, stereo_every=self.stereo_every, video_scale=self.video_scale)
        return to_and_fro(drive, self.exposures)


class Meter:
    """Hears of each new state in the worker's thread; the headless run goes on there, too: so both meet the machine in
    the same mood."""

    def __init__(self, session: Session, served: Served, folder: Path, until_end: ExitStack) -> None:
        """`folder` is the headless run's, whose files stay open until `until_end` is closed."""
        self._session, self._branch_at, self._runs = session, served.branch_at, 0
        self._headless: Playback | None = None
        if served.headless:
            sequence = served.open()
            methods = session.state.methods or served.methods or default_methods(sequence.rig)
            self._headless = Playback(sequence, methods)
            options = Run(source=served.source, methods=methods, out=folder)
            job = Job(options, methods, None, self._headless, Until(None), until_end.enter_context(RunFolder(folder)))
            self._steps = Steps(job, Signals(), until_end)
        self._computed, self._since_s = 0, 0.0
        self._ms: dict[str, list[float]] = {"worker_ms": [], "headless_ms": []}

    def __call__(self) -> None:
        state = self._session.state
        if state.computed == self._computed + 1 and state[Branches].shown == 0:
            self._count()
        self._computed = state.computed
        if state.ended and state[Branches].shown == self._runs:
            self._runs += 1
            sys.stdout.write(json.dumps(self._found()) + "\n")
            sys.stdout.flush()
            if self._runs == 1 and self._branch_at is not None:
                self._session.post(do.Seek(self._branch_at - 1))
                self._session.post(Fork(state.methods, state.config))

    def _count(self) -> None:
        now = time.thread_time()
        if self._computed:  # the first one waits for what is compiled and opened
            self._ms["worker_ms"].append(1e3 * (now - self._since_s))
        if self._headless is not None:
            self._steps.step()
            if self._computed:
                self._ms["headless_ms"].append(1e3 * (time.thread_time() - now))
        self._since_s = time.thread_time()

    def _found(self) -> dict[str, object]:
        found: dict[str, object] = {name: float(np.mean(ms)) for name, ms in self._ms.items() if ms}
        if self._headless is not None and self._session.run is not None:
            found["same"] = _texts(self._session.run.finish()) == _texts(self._headless.finish())
        return found


def _texts(finished: Finished) -> dict[str, str]:
    return {method: tum_text(trajectory) for method, trajectory in finished.trajectories.items()}


def main(argument: str) -> int:
    task = json.loads(argument)
    served = Served(**(task | {"methods": tuple(task.get("methods", ()))}))
    with tempfile.TemporaryDirectory() as folder, ExitStack() as until_end:

        def session(live) -> Session:
            found = Session(
                lambda *_: served.open(),
                served.source,
                Path(folder, "app"),
                live=live,
                autoplay=False,
                methods=served.methods or None,
            )
            found.changes.add(Meter(found, served, Path(folder, "headless"), until_end))
            found.post(do.Speed(None))
            return found

        return serve(session, Serving(port=0, open_browser=False))


if __name__ == "__main__":
    end_with_parent()
    sys.exit(main(sys.argv[1]))
