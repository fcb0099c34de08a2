"""A fork with nothing changed against its parent, to the byte: through the session, as the page forks, and by
`ispom fork`.

`python -m tests.app.forked SOURCE [OPTIONS OF ISPOM RUN]` forks a run over a recording at five frames for each of
its methods, and prints what differs.
"""

from __future__ import annotations

import csv
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ispom_app.cli.commands import COMMANDS
from ispom_app.cli.main import main as ispom
from ispom_app.engine.events import blank
from ispom_app.engine.model.map_memory import MapCollectors
from ispom_app.engine.run_folder.results import in_frame
from ispom_app.engine.run_folder.run_folder import LANDMARKS, STEPS, RunFolder, trajectory_file
from ispom_app.engine.run_folder.step_log import StepLog
from ispom_app.features.branches.commands import DeleteBranch, Fork, ShowBranch
from ispom_app.session import commands as do
from ispom_app.session.branches.state import Branches
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.session import Session
from ispom_app.session.setup import SessionSetup

from ispom.ensemble import build
from ispom.io.maps import map_bytes
from ispom.io.trajectories import tum_text
from ispom.methods import default_methods, in_order, with_dependencies
from tests.app.helpers import wait_for

TIMES = ("seconds", "stages")
"""Columns of steps.csv that the clock on the wall has a part in."""
PATIENCE_S = 600.0

Files = dict[str, bytes | list[dict[str, str]]]
"""What a run wrote of its methods, by name of the file; of steps.csv the rows, without measured times."""


def files_in(folder: Path, methods: tuple[str, ...]) -> Files:
    found: Files = {name: (folder / name).read_bytes() for name in (LANDMARKS, *map(trajectory_file, methods))}
    return found | {STEPS: [{k: v for k, v in row.items() if k not in TIMES} for row in rows(folder)]}


def rows(folder: Path) -> list[dict[str, str]]:
    """Of its steps.csv."""
    with (folder / STEPS).open(newline="") as file:
        return list(csv.DictReader(file))


def files_of(run: CurrentRun, methods: tuple[str, ...], folder: Path) -> Files:
    """Of a run in the session: written to `folder` from its history and its end."""
    finished, maps, rig = run.finish(), MapCollectors(), run.playback.sequence.rig
    with RunFolder(folder) as place, StepLog(place) as log:
        for record in run.history:
            log.add(record.stepped(blank(run.playback.sequence, record.index)))
            maps.add(record.steps)
        for method in methods:
            poses = in_frame(finished.trajectories[method], rig, "rig", run.playback.unit_m(method))
            place.write(trajectory_file(method), tum_text(poses))
        place.write(LANDMARKS, map_bytes(maps.scenes(finished.trajectories, methods, rig)))
    return files_in(folder, methods)


def differing(files: Files, parent: Files) -> list[str]:
    return [name for name in parent if files[name] != parent[name]]


def worth_forking(folder: Path, method: str) -> list[int]:
    """Of a run, five first frames of forks: just before a keyframe, at it and after it; and at a loss, in it and
    after it, or where there is none around a later keyframe.

    An integration's segment ends at its keyframes: so one fork is in a segment, one at its end, one in the next.
    """
    own = [row for row in rows(folder) if row["method"] == method]
    at = [int(row["exposure"]) for row in own]
    keys = [i for i, row in enumerate(own) if row["key_frame"] == "1" and 0 < i < len(own) - 2]
    lost = [i for i, row in enumerate(own) if row["status"] == "lost" and 0 < i < len(own) - 2]
    key = keys[len(keys) // 3]
    chosen = {key - 1, key, key + 1}
    if lost:
        chosen |= {lost[0], lost[len(lost) // 2], lost[-1] + 1}
    later = (i for key in reversed(keys) for i in (key, key - 1, key + 1) if i not in chosen)
    while len(chosen) < 5:
        chosen.add(next(later))
    return [at[i] for i in sorted(chosen)][:6]


@contextmanager
def played(arguments: list[str], methods: tuple[str, ...], folder: Path) -> Iterator[Session]:
    """A session, as the page has it, over what the arguments of `ispom run` say; run to its end."""
    options = COMMANDS.get("run").read(arguments)
    session = Session(
        SessionSetup(
            lambda _: options.open(options.source),
            options.source,
            folder,
            methods=methods,
            config=options.config,
            builder=build,
        )
    )
    session.start()
    session.post(do.Speed(None))
    try:
        wait_for(lambda: session.state.ended, "the end of the run", PATIENCE_S)
        yield session
    finally:
        assert session.close(20.0)


def fork_in(session: Session, at: int) -> CurrentRun:
    """Shows the frame before `at` of the first run, forks there with nothing changed, and waits for the end."""
    session.post(ShowBranch(0))
    session.post(do.Seek(at - 1))
    wait_for(lambda: session.state[Branches].shown == 0 and session.state.index == at - 1, "the frame")
    session.post(Fork(session.state.methods, session.state.config))
    # One state says both: the session has the branch's run before that state, when the parent's is ended still.
    wait_for(lambda: (state := session.state)[Branches].shown != 0 and state.ended, "the end of the branch", PATIENCE_S)
    found, number = session.run, session.state[Branches].shown
    assert (
        found is not None and session.state[Branches].all[-1].at == at and not session.state[Branches].all[-1].changes
    )
    session.post(ShowBranch(0))
    session.post(DeleteBranch(number))
    wait_for(lambda: len(session.state[Branches].all) == 1, "room for the next")
    return found


def fork_by_command(run: Path, at: int, out: Path) -> Path:
    assert ispom(["fork", str(run), "--at", str(at), "--out", str(out), "--no-recording"]) == 0
    return out


def main(arguments: list[str]) -> int:
    """Prints, for each fork, what of its files differs from the parent's."""
    options = COMMANDS.get("run").read(arguments)
    methods = in_order(options.methods) or default_methods(options.open(options.source).rig)
    methods_run, differing_rows = with_dependencies(methods), 0
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        parent = place / "parent"
        assert ispom(["run", *arguments, "--methods", *methods_run, "--out", str(parent), "--no-recording"]) == 0
        expected = files_in(parent, methods_run)
        places = {method: worth_forking(parent, method) for method in methods}
        say(*(f"{method}: forks at {at}" for method, at in places.items()))
        with played(arguments, methods_run, place / "session") as session:
            assert session.run is not None
            say(f"the page's run: {differing(files_of(session.run, methods_run, place / 'page'), expected) or 'same'}")
            for at in sorted(set().union(*places.values())):
                page = differing(files_of(fork_in(session, at), methods_run, place / f"page-{at}"), expected)
                command = differing(files_in(fork_by_command(parent, at, place / f"fork-{at}"), methods_run), expected)
                say(f"at {at}: page {page or 'same'}, ispom fork {command or 'same'}")
                differing_rows += bool(page or command)
    return 1 if differing_rows else 0


def say(*lines: str) -> None:
    sys.stdout.write("".join(f"{line}\n" for line in lines))
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
