"""Which files of the program a step, a changed setting and a fork enter: `python -m tests.app.traces` prints them.

The session runs on stand-ins for the estimators, with the viewers' stream and the panels. The page's message is decoded
and its next state is made as for a browser, with the view values; the page's own scripts are not counted.
"""

from __future__ import annotations

import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType
from typing import Any

from ispom_app.features.branches.commands import Fork
from ispom_app.session.branches.state import Branches
from ispom_app.session.commands import Restart
from ispom_app.session.session import Session
from ispom_app.views.rerun.live import LiveStream
from ispom_app.views.viser.screen import Screen
from ispom_app.views.web.messages import command_of, message_of
from ispom_app.views.web.news import Look
from ispom_app.views.web.view_values import ViewNews

from ispom.methods import Config
from tests import doubles
from tests.app.helpers import started, wait_for

ROOT = Path(__file__).parents[2]
ESTIMATORS = ("estimators", "solvers", "features", "numerics", "calibration")
"""Folders of the library that are the estimators' own."""
METHODS = ("monocular", "stereo")


class Entered:
    """The files whose functions are called while it is on."""

    def __init__(self) -> None:
        self.files: set[str] = set()
        self.on = False

    def profile(self, frame: FrameType, event: str, argument: object) -> None:
        if self.on and event == "call":
            path = frame.f_code.co_filename
            if path.startswith(str(ROOT)) and not path.startswith(str(ROOT / "tests")):
                parts = Path(path).relative_to(ROOT).parts
                if parts[0] in ("app", "ispom") and not (parts[0] == "ispom" and parts[1] in ESTIMATORS):
                    self.files.add("/".join(parts))


@contextmanager
def watched(folder: Path) -> Iterator[tuple[Entered, Session, Callable[[], Any]]]:
    """A session that has shown its tenth frame; what paints the page; and the files that are entered from then on."""
    entered = Entered()
    threading.setprofile(entered.profile)
    live = LiveStream()
    session = started(
        folder, opener=lambda source, options=None: doubles.sequence(40), live=live, methods=METHODS, autoplay=False
    )
    screen, views = Screen(session), ViewNews()
    sys.setprofile(entered.profile)

    def paint() -> dict[str, Any]:
        screen.paint()
        state = session.state
        return message_of(state) | views.of(Look(session, "", state, state, session.run))

    try:
        wait_for(lambda: session.state.phase == "ready", "the run")
        session.post(command_of('{"do": "play", "on": false}'))  # type: ignore[arg-type]
        session.post(command_of('{"do": "seek", "index": 10}'))  # type: ignore[arg-type]
        wait_for(lambda: session.state.index == 10 and session.state.target is None, "frame 10")
        paint()
        yield entered, session, paint
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
        screen.server.stop()
        session.close(5.0)
        live.close()


def files_of(act: Callable[[Session], None], done: Callable[[Session], object]) -> list[str]:
    """Those that are entered between an act and what the page shows of it."""
    with TemporaryDirectory() as folder, watched(Path(folder)) as (entered, session, paint):
        entered.on = True
        act(session)
        wait_for(lambda: done(session), "its end")
        paint()
        entered.on = False
        return sorted(entered.files)


def step() -> list[str]:
    """One frame on, which is computed."""
    return files_of(
        lambda session: session.post(command_of('{"do": "step_by", "count": 1}')),  # type: ignore[arg-type]
        lambda session: session.state.index == 11,
    )


def fork() -> list[str]:
    """Another branch from the frame shown on, up to its first frame."""
    return files_of(
        lambda session: session.post(Fork(("stereo",), Config())),
        lambda session: session.state[Branches].shown == 1 and session.state.index > 10,
    )


def setting() -> list[str]:
    """The run again, from its first frame on, with another setting."""
    config = Config({"stereo": replace(Config().of("stereo"), max_tracks=300)})
    return files_of(
        lambda session: session.post(Restart(METHODS, config)),
        lambda session: session.state.run == 2 and session.state.index >= 0,
    )


if __name__ == "__main__":
    for trace in (step, setting, fork):
        found = trace()
        rooms = Counter("/".join(name.split("/")[:2]) for name in found)
        counts = ", ".join(f"{room} {count}" for room, count in sorted(rooms.items()))
        sys.stdout.write(
            f"{trace.__name__}: {len(found)} files ({counts})\n" + "".join(f"  {name}\n" for name in found)
        )
