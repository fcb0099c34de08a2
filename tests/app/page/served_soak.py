"""The app of `soak`, as a process of its own: it holds what a user's does, and nothing that only tests need.

`python -m tests.app.page.served_soak FOLDER SOURCE COUNT [BRANCH_AT]` forks there, with nothing changed, when the run
is over.
"""

from __future__ import annotations

import sys
from pathlib import Path

from ispom_app.engine.options import SourceOptions
from ispom_app.features.benchmark.page.drive import to_and_fro
from ispom_app.features.branches.commands import Fork
from ispom_app.features.branches.state import Branches
from ispom_app.session import commands as do
from ispom_app.session.session import Session
from ispom_app.views.web.server import Serving, serve

from ispom.sequences import open_sequence
from ispom.types import Sequence


def serve_soak(folder: Path, source: str, count: int, branch_at: int | None = None) -> int:
    """The app, as a process of its own."""

    def opener(source: str, options: SourceOptions | None = None) -> Sequence:
        return to_and_fro(open_sequence(source), count)

    def session(live) -> Session:
        found = Session(opener, source, folder, live=live)
        found.post(do.Speed(None))

        def fork() -> None:
            state = found.state
            if branch_at is not None and state.ended and state[Branches].shown == 0 and len(state[Branches].all) == 1:
                found.changes.remove(fork)
                found.post(do.Seek(branch_at - 1))
                found.post(Fork(state.methods, state.config))

        found.changes.add(fork)
        return found

    return serve(session, Serving(port=0, open_browser=False))


if __name__ == "__main__":
    sys.exit(serve_soak(Path(sys.argv[1]), sys.argv[2], *map(int, sys.argv[3:])))
