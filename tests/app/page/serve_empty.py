"""The app without a source, with stand-in estimators: `python -m tests.app.page.serve_empty FOLDER`. The demo of its
start screen is the stand-in sequence, too."""

from __future__ import annotations

import sys
from pathlib import Path

from ispom_app.engine.options import SourceOptions
from ispom_app.session.session import Session
from ispom_app.session.setup import SessionSetup
from ispom_app.session.sources.folders import Folders
from ispom_app.views.web.server import Serving, serve

from ispom.sequences import open_sequence
from ispom.types import Sequence
from tests.app import helpers


def opener(source: str, options: SourceOptions | None = None) -> Sequence:
    return helpers.opener("double:40") if source.startswith("sim:") else open_sequence(source)


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    sys.exit(
        serve(
            lambda live: Session(
                SessionSetup(opener, "", folder, builder=helpers.build, folders=Folders(folder)), live
            ),
            Serving(port=0, base="/ispom/", open_browser=False),
        )
    )
