"""The app with stand-in estimators, a process of its own: `python -m tests.app.page.serve_double FOLDER PORT [SOURCE]`.

Without a source it plays the stand-in sequence; with one, the page looks for others beside it. `slow:FILE` is the
stand-in sequence, too, which takes until there is such a file to open; on `lossy`, methods are lost at every eleventh
frame.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from ispom_app.engine.options import SourceOptions
from ispom_app.session.session import Session
from ispom_app.session.setup import SessionSetup
from ispom_app.session.sources.folders import Folders
from ispom_app.views.web.server import Serving, serve

from ispom.sequences import open_sequence
from ispom.types import Sequence
from tests.app import helpers

DOUBLE, SLOW, LOSSY = "double:40", "slow:", "lossy"


def opener(source: str, options: SourceOptions | None = None) -> Sequence:
    if source.startswith(SLOW):
        while not Path(source.removeprefix(SLOW)).exists():
            time.sleep(0.02)
        source = DOUBLE
    source = DOUBLE if source == LOSSY else source
    return helpers.opener(source) if source.startswith("double:") else open_sequence(source)


if __name__ == "__main__":
    folder, port, source = Path(sys.argv[1]), int(sys.argv[2]), (sys.argv[3:] or [DOUBLE])[0]
    folders = Folders(Path(source).parent if source not in (DOUBLE, LOSSY) else None)
    builder = helpers.build_full if source == LOSSY else helpers.build
    sys.exit(
        serve(
            lambda live: Session(SessionSetup(opener, source, folder, builder=builder, folders=folders), live),
            Serving(port=port, base="/ispom/", open_browser=False),
        )
    )
