"""The runs that are published, opened in a session as the page has them for review, without their images."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ispom.errors import InputError
from ispom.io.files import exists
from ispom.sequences.address import without_secrets
from ispom.types import Sequence

from ...engine.run_folder.run_file import read_run_file
from ...engine.run_folder.run_folder import MARKER, RECORDING, RUN, ended_early
from ...session.branches.branches import NOTHING
from ...session.branches.comparison import Comparison
from ...session.branches.service import BranchService
from ...session.branches.state import Branches
from ...session.session import Session
from ...session.setup import SessionSetup
from ...session.state import State
from ..runs.compare import comparison_message
from ..runs.frame_picture import WIDTH_PX, frame_picture
from ..runs.live import live_rows
from .commands import AddRun
from .messages import finished_state

NO_SOURCE = "a published run has no source"
POLL_S = 0.01
"""Interval between two looks at the progress of the session's worker."""
CLOSE_S = 5.0


@dataclass(frozen=True)
class Review:
    """The first run on the screen, and what its comparisons with the others found."""

    session: Session
    state: State
    """Of a page that shows it."""
    names: tuple[str, ...]
    """Of the runs, by the number of their branch."""
    comparisons: tuple[dict[str, Any], ...]
    """Of the first run with each of the others."""
    pictures: tuple[tuple[bytes, bytes] | None, ...]
    """By comparison: of both runs the image at the frame where their paths part, with its tracks, as JPEG. None where
    they do not part, or a recording has no image there."""


@contextmanager
def reviewed(folders: list[Path], names: list[str], *, compares: bool = True) -> Iterator[Review]:
    """Opens the runs; where they are not compared, the others are drawn beside the first one, whatever their frames
    are. Raises InputError where a folder holds no complete run with a recording, or compared runs differ in their
    frames."""
    for folder in folders:
        require_run(folder)
    with TemporaryDirectory() as empty:
        session = Session(SessionSetup(no_images, str(folders[0]), Path(empty), autoplay=False))
        session.start()
        try:
            _wait(lambda: session.state.phase != "opening")
            if session.state.phase != "ready":
                raise InputError(session.state.failure)
            others = zip(folders[1:], names[1:], strict=True)
            added = [_added(session, folder, name, compares=compares) for folder, name in others]
            comparisons = [each for each in added if each is not None]
            _wait(lambda: _measured(session))
            messages = tuple(_message(session, each, Path(empty)) for each in comparisons)
            pictures = tuple(_pictures(session, each) for each in messages)
            yield Review(session, finished_state(session.state, names[0]), tuple(names), messages, pictures)
        finally:
            session.close(CLOSE_S)


def require_run(folder: Path) -> None:
    """Raises InputError where the folder holds no run with a recording, or one that was killed or goes on."""
    if not exists(folder / RUN):
        raise InputError(f"{folder} holds no run: give a folder that `ispom run` wrote")
    read_run_file(folder)
    if exists(folder / MARKER) and not ended_early(folder):
        raise InputError(f"{folder} holds a run that is not complete: run it again, then publish it")
    if not exists(folder / RECORDING):
        raise InputError(f"{folder} has no {RECORDING}, which the stage is made of: run again without --no-recording")


def no_images(source: str, _: object = None) -> Sequence:
    raise InputError(NO_SOURCE)


def _added(session: Session, folder: Path, name: str, *, compares: bool) -> Comparison | None:
    """Adds a run, and waits until its comparison with the first one is complete, where there is one."""
    notices, branches = session.state.notice_count, session.state[Branches]
    session.post(AddRun(str(folder), name, compares))

    def done() -> bool:
        if compares:
            return _finished(session, branches.comparison)
        return len(session.state[Branches].all) > len(branches.all)

    _wait(lambda: session.state.notice_count > notices or done())
    if not done():
        raise InputError(f"{folder} cannot be shown beside the first run: {session.state.notices[-1].text}")
    found = session.state[Branches].comparison
    if found is not None:
        _require_same_frames(session, found, folder)
    return found


def _finished(session: Session, before: Comparison | None) -> bool:
    now = session.state[Branches].comparison
    return now is not None and now.finished and (before is None or now.other != before.other)


def _require_same_frames(session: Session, comparison: Comparison, folder: Path) -> None:
    """Of frames that only one of the runs used the times are not known to the other."""
    runs = [session.service(BranchService).run_of(n) for n in (comparison.shown, comparison.other)]
    times = [{r.index: r.time_ns for r in run.history if r.steps} for run in runs if run is not None]
    common = times[0].keys() & times[1].keys()
    if not common or any(times[0][index] != times[1][index] for index in common):
        raise InputError(f"{folder} has other frames than the first run: publish runs on one source together")


def _measured(session: Session) -> bool:
    """Whether all runs were measured: errors are known where there is a ground truth."""
    return all(branch.measured is not NOTHING for branch in session.state[Branches].all)


def _message(session: Session, comparison: Comparison, recordings: Path) -> dict[str, Any]:
    state, run_of = session.state, session.service(BranchService).run_of
    return comparison_message(state, comparison, live_rows(state, run_of, recordings), run_of)


def _pictures(session: Session, message: dict[str, Any]) -> tuple[bytes, bytes] | None:
    place = (message["view"] or {}).get("parting")
    if place is None:
        return None
    runs = [session.service(BranchService).run_of(number) for number in message["numbers"]]
    a, b = (None if run is None else frame_picture(run, place["frame"], place["method"], WIDTH_PX) for run in runs)
    return None if a is None or b is None else (a, b)


def _wait(condition: Callable[[], object]) -> None:
    while not condition():
        time.sleep(POLL_S)


def plain_name(folder: Path) -> str:
    """What a published page calls a run: the last part of its path, as people see it."""
    return without_secrets(folder.resolve().name) or "run"
